"""Fixtures of the recordings of machines."""

import pytest


@pytest.fixture
def call(call, monkeypatch, tmp_path):
    """`call` in an empty folder."""
    monkeypatch.chdir(tmp_path)
    return call
