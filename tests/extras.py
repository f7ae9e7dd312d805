"""Marks for tests that need a package of an extra. `make install` does not install extras."""

from importlib.util import find_spec

import pytest

NEEDS_CASADI = pytest.mark.skipif(find_spec("casadi") is None, reason="needs casadi; pip install agrobot-mj[nmpc]")
NEEDS_SYSID = pytest.mark.skipif(find_spec("absl") is None, reason="needs absl; pip install agrobot-mj[sysid]")
