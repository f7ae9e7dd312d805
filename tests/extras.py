"""Pytest marks for tests that need a package of an optional extra, which `make install` does not install."""

from importlib.util import find_spec

import pytest

NEEDS_CASADI = pytest.mark.skipif(find_spec("casadi") is None, reason="needs casadi; pip install agrobot-mj[nmpc]")
NEEDS_SYSID = pytest.mark.skipif(find_spec("absl") is None, reason="needs absl; pip install agrobot-mj[sysid]")
