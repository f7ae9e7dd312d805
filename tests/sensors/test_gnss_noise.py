"""Correlated receiver noise compared with theory: autocovariance and Allan deviation of sums of processes."""

from functools import cache
from math import exp, sqrt

import numpy as np
import pytest

from agrobot_mj import load_scenario
from agrobot_mj.core.signals import NOMINAL, Quality, Truth
from agrobot_mj.sensors import Gnss

DT = 0.05
AT = (10.0, -5.0, 2.0)
REAL = Gnss(
    **{"sigma_m": 0.003, "correlated_fraction": 0.0, "velocity_sigma_m_s": 0.0},
    **{"multipath_sigma_m": 0.006, "multipath_time_s": 4.0, "drift_sigma_m": 0.01, "drift_time_s": 30.0},
)
"""Receiver with typical noise, but with correlation times short enough for a test."""
LONGEST_LAG_S = 4.0


def truth(t=0.0):
    return Truth(
        *(t, 9.0, -6.0, 0.5, 0.3, 0.0, 0.0, 1.2, 0.0, 0.0, 0.1, 0.5, 10.3, -4.7),
        antenna=AT,
        antenna_velocity=(1.1, 0.4, 0.0),
        steer_samples=np.full(25, 0.1),
        pedal_samples=np.full(25, 0.5),
    )


def errors(gnss, ticks, seed=5, quality=Quality.FIX):
    """Return the errors to the east, north and up, shape (ticks, 3) [m]."""
    state, now, found = gnss.init(seed), truth(), []
    conditions = NOMINAL._replace(gnss_quality=quality)
    for _ in range(ticks):
        state, (fix, _) = gnss.measure(state, now, conditions, DT)
        found.append((fix.x, fix.y, fix.z))
    return np.array(found) - AT


@cache
def long_errors():
    """Return the errors of one long run of `REAL`."""
    return errors(REAL, 40_000)


@cache
def errors_of_runs():
    """Return errors of `REAL` over LONGEST_LAG_S from the stationary distribution, shape (1200, ticks, 3) [m]."""
    return np.array([errors(REAL, round(LONGEST_LAG_S / DT) + 1, seed) for seed in range(1200)])


def variance_of_sum(gnss, lag_s):
    """Return the autocovariance of an axis at a lag [m2], which is the sum over the independent processes."""
    white = gnss.sigma_m**2 if lag_s == 0 else 0.0
    a, b = gnss.multipath_sigma_m**2, gnss.drift_sigma_m**2
    return white + a * exp(-lag_s / gnss.multipath_time_s) + b * exp(-lag_s / gnss.drift_time_s)


def allan(error, ticks):
    """Return the overlapping Allan deviation over `ticks` of a phase-like series sampled at DT [m/s]."""
    second = error[2 * ticks :] - 2 * error[ticks:-ticks] + error[: -2 * ticks]
    return sqrt(np.mean(second**2) / 2) / (ticks * DT)


def test_default_gnss_noise_equals_the_published_values():
    assert (Gnss().multipath_sigma_m, Gnss().drift_sigma_m, Gnss().canopy) == (0.0, 0.0, ())


@pytest.mark.parametrize("lag_s", [0.0, 0.05, 1.0, LONGEST_LAG_S])
def test_gnss_autocovariance_is_the_sum_of_its_error_components(lag_s):
    """The mean is over runs from the stationary distribution, because a time mean would remove the slow component."""
    pairs = errors_of_runs()[:, [0, round(lag_s / DT)]]
    for axis, scale in enumerate((1.0, 1.0, REAL.height_ratio**2)):
        first, last = pairs[:, 0, axis], pairs[:, 1, axis]
        expected, total = scale * variance_of_sum(REAL, lag_s), scale * variance_of_sum(REAL, 0.0)
        spread = sqrt((total**2 + expected**2) / len(pairs))  # of a mean of products of two Gaussians
        assert np.mean(first * last) == pytest.approx(expected, abs=4 * spread)


@pytest.mark.parametrize("tau_s", [0.05, 0.5, 2.0, 10.0])
def test_gnss_allan_deviation_is_the_sum_of_its_error_components(tau_s):
    """A stationary series with autocovariance C has second differences of variance 6 C(0) - 8 C(tau) + 2 C(2 tau)."""
    error, ticks = long_errors(), round(tau_s / DT)
    second = 6 * variance_of_sum(REAL, 0) - 8 * variance_of_sum(REAL, tau_s) + 2 * variance_of_sum(REAL, 2 * tau_s)
    expected = sqrt(second / 2) / tau_s
    independent = 40_000 * DT / (2 * tau_s) if tau_s > 0.5 else 4000
    for axis, scale in enumerate((1.0, 1.0, REAL.height_ratio)):
        assert allan(error[:, axis], ticks) == pytest.approx(scale * expected, rel=4 / sqrt(2 * independent) + 0.03)


def test_rtk_noise_scenario_has_millimetre_jitter_and_centimetre_drift():
    """Noise of the scenario `rtk_noise` from tick to tick and over 5 minutes; the default jitter is 2.4 cm."""
    gnss = load_scenario("rtk_noise").sensors.gnss
    jitter, paper = (np.diff(errors(part, 2000)[:, 0]).std() for part in (gnss, Gnss()))
    assert 0.002 < jitter < 0.006
    assert 0.02 < paper < 0.027
    total = sqrt(variance_of_sum(gnss, 0.0))
    assert 0.008 < total < 0.02
    wander = sqrt(2 * (variance_of_sum(gnss, 0.0) - variance_of_sum(gnss, 300.0)))
    assert 0.005 < wander < 0.02


def test_gnss_errors_in_east_and_north_are_independent():
    error = np.array([errors(REAL, 1, seed)[0] for seed in range(1500)])
    assert np.abs(np.corrcoef(error.T)[np.triu_indices(3, 1)]).max() < 5 / sqrt(1500)


def test_additional_error_component_does_not_change_other_noise():
    """With an additional component, the error of the paper is bit-identical."""
    plain, more = Gnss(), Gnss(drift_sigma_m=0.01)
    drift = Gnss(sigma_m=0.0, drift_sigma_m=0.01)
    assert errors(more, 50) == pytest.approx(errors(plain, 50) + errors(drift, 50), abs=1e-12)


def test_float_solution_has_no_error_components_of_a_fixed_solution():
    plain, more = Gnss(), Gnss(drift_sigma_m=5.0, multipath_sigma_m=5.0)
    assert np.array_equal(errors(plain, 50, quality=Quality.FLOAT), errors(more, 50, quality=Quality.FLOAT))


def test_height_error_has_the_configured_ratio_and_is_nan_without_a_fix():
    error = errors(Gnss(height_ratio=3.0, correlated_fraction=0.0), 4000)
    assert error[:, 2].std() == pytest.approx(0.06, rel=5 / sqrt(8000))
    gnss = Gnss()
    _, reading = gnss.measure(gnss.init(1), truth(), NOMINAL._replace(gnss_quality=Quality.NONE), DT)
    assert np.isnan(gnss.report(reading)).all()
