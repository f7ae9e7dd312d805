"""Diagnostics of the estimators: consistent uncertainty with default noise, latency of the fix, smoothed NIS."""

from math import nan

import numpy as np
import pytest
from recorded_drives import BIAS, FULL, PAPER, follow, record

from agrobot_mj.control.supervisor import Supervisor
from agrobot_mj.core.signals import NOMINAL, Quality
from agrobot_mj.core.spec import every
from agrobot_mj.estimation import Ekf, Estimator
from agrobot_mj.estimation.base import NIS_MOST, Health, largest_sigma
from agrobot_mj.machine.tractor import TractorParameters
from agrobot_mj.sensors import Sensors

DT = 0.05


@pytest.fixture(scope="module")
def drive():
    """Return 45 s of a figure-eight of the MuJoCo tractor."""
    return record("figure_eight", {}, 45.0)


def nees(drive, kind):
    """Return the mean normalised squared position error with the receiver's default, correlated errors."""
    assert drive.scenario.sensors.gnss == Sensors().gnss
    return np.mean([follow(drive, kind, seed).nees[400:].mean() for seed in range(6)])


@pytest.mark.parametrize("kind", [BIAS, FULL], ids=["ekf_bias", "ekf_full"])
def test_reported_uncertainty_is_consistent_or_slightly_conservative(drive, kind):
    assert 1.0 < nees(drive, kind) < 3.0


def test_ekf_underestimates_its_uncertainty_for_correlated_errors(drive):
    assert nees(drive, PAPER) > 4.0


@pytest.mark.parametrize("spec", every(Estimator))
def test_estimator_reports_fix_age_sigma_and_innovation_statistic(drive, spec):
    """Fixes end after six seconds. Then the latency of the fix and sigma grow, and the smoothed NIS is constant."""
    estimator, sensors, first = spec(), drive.scenario.sensors, drive.truths[0]
    state = estimator.init(first.rear_x, first.rear_y, first.yaw, TractorParameters())
    sensing, estimates = sensors.init(1), []
    for truth in drive.truths[:240]:
        day = NOMINAL if truth.t < 6.0 else NOMINAL._replace(gnss_quality=Quality.NONE)
        sensing, measured = sensors.measure(sensing, truth, day, DT)
        state, estimate = estimator.update(state, measured, DT)
        estimates.append(estimate)
    assert estimates[100].fix_age == pytest.approx(0.0, abs=1e-9)
    assert estimates[-1].fix_age == pytest.approx(6.0, abs=1e-6)
    assert estimates[-1].position_sigma > 2 * estimates[100].position_sigma > 0.0
    assert estimates[-1].nis_mean == estimates[125].nis_mean
    assert 0.5 < estimates[100].nis_mean < 5.0
    assert estimates[-1].aligned


def test_smoothed_innovation_statistic_converges_and_clips_outliers():
    health = Health()
    for _ in range(1000):
        health = health.after(5.0, 1.0, DT)
    assert health.nis == pytest.approx(5.0, rel=1e-3)
    assert health.after(nan, nan, DT) == health
    assert health.after(1e9, nan, DT) == health.after(NIS_MOST, nan, DT)


def test_innovation_limit_is_exceeded_by_5_s_of_outliers_not_by_one_fix():
    health = Health()
    assert health.after(1e9, 1.0, DT).nis < 10.0
    for _ in range(100):
        health = health.after(1e9, 1.0, DT)
    assert NIS_MOST > health.nis > Supervisor().max_nis > 100.0, "fault-free runs across ridges reach 85"


def test_maximum_sigma_is_the_root_of_the_largest_eigenvalue():
    P = np.array([[4.0, 1.5], [1.5, 1.0]])
    assert largest_sigma(P) == pytest.approx(np.sqrt(np.linalg.eigvalsh(P)[-1]))


def test_ekf_requires_no_optional_sensors_and_reports_no_columns():
    assert Ekf().needs == {}
    assert Ekf().columns == ()
