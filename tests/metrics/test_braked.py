"""Distance that a tractor moves under its brake."""

import numpy as np
import pytest

from agrobot_mj.core.signals import TICK_S
from agrobot_mj.metrics.base import RunView
from agrobot_mj.metrics.safety import STOPPED_S, BrakedDrift, drift_text
from agrobot_mj.paths import Line

ROWS, STOPPED = 400, round(STOPPED_S / TICK_S)


class Parked:
    """Log with the brake state and the position in each row."""

    def __init__(self, brake, x):
        self.columns = {"brake": brake, "x": x, "y": np.zeros(ROWS), "t": TICK_S * np.arange(ROWS)}
        self.scenario = self
        self.path, self.duration_s = Line(), None

    def column(self, name):
        return self.columns[name]


def drift(brake, x):
    return BrakedDrift().evaluate(RunView(Parked(brake, x)))["braked_drift_m"]


def between(first, last):
    rows = np.arange(ROWS)
    return ((rows >= first) & (rows < last)).astype(float)


def test_drift_of_the_braked_tractor_excludes_motion_before_standstill():
    x = np.minimum(np.arange(ROWS), 100 + STOPPED) * 0.01
    assert drift(between(100, 300), x) == 0.0
    assert drift(between(100, 300), np.arange(ROWS) * 0.01) == pytest.approx((300 - 100 - STOPPED - 1) * 0.01)


def test_maximum_of_several_braked_drifts_is_reported():
    x = 1e-5 * np.arange(ROWS)
    assert drift(between(0, 60) + between(100, 390), x) == pytest.approx(1e-5 * (390 - 100 - STOPPED - 1))


def test_run_without_a_parked_tractor_has_no_braked_drift():
    x = np.arange(ROWS) * 0.01
    assert drift(np.zeros(ROWS), x) is None
    assert drift(between(5, 5 + STOPPED), x) is None


@pytest.mark.parametrize(("metres", "text"), [(None, ""), (0.0004, ""), (0.0123, "moved 12.3 mm while its brake")])
def test_simulated_run_reports_the_drift_of_its_parked_tractor(metres, text):
    assert drift_text({"braked_drift_m": metres}).startswith(text)
    assert bool(drift_text({"braked_drift_m": metres})) == bool(text)
