"""Fixtures for the tests of logs."""

import pytest

from agrobot_mj.extensions.logs.identify import fit


@pytest.fixture
def quick_fit(monkeypatch):
    """Fit vehicle and sensors in one round with few noise samples. The results are less accurate, but sufficient for
    tests of rejections, texts, files and large errors.
    """
    monkeypatch.setattr(fit, "ROUNDS", 1)
    monkeypatch.setattr(fit, "SHORT", 1)
    monkeypatch.setattr(fit, "PAIRS", 2)
