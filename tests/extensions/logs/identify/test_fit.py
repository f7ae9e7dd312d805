"""Numerics of the fit: intervals, windows, and errors that are correlated over more than a window."""

from math import sqrt

import numpy as np
import pyarrow as pa
import pytest
from scipy.stats import t as student

from agrobot_mj.extensions.logs.identify.fit import SLOW_S, VehicleFit, _bootstrap, noise_of, whiten
from agrobot_mj.extensions.logs.identify.model import STEP_S, Chassis2
from agrobot_mj.extensions.logs.identify.vehicle import vehicle_quantities
from agrobot_mj.extensions.logs.identify.windows import WINDOW_S, _smooth_heading, prepare
from agrobot_mj.extensions.logs.maps import LogMap
from agrobot_mj.extensions.logs.recording import read_recording
from agrobot_mj.extensions.logs.series import TimeSeries

CHASSIS = Chassis2(750.0, 400.0, 0.9, 0.5, False)


def test_understeer_interval_follows_from_both_axle_compliances():
    """The variance of K = m (l_r / C_f - l_f / C_r) / L is the variance of a weighted sum of the two compliances."""
    C, sigma, rho = np.array([6e-5, 4e-5]), np.array([5e-6, 8e-6]), -0.4
    covariance = np.diag(sigma**2)
    covariance[0, 1] = covariance[1, 0] = rho * sigma[0] * sigma[1]
    fit = VehicleFit(("front_compliance", "rear_compliance"), C, covariance, 23)
    found = vehicle_quantities(fit, CHASSIS)
    a, b = 750.0 * 0.5 / 1.4, 750.0 * 0.9 / 1.4
    half = student.ppf(0.975, 23) * sqrt(
        (a * sigma[0]) ** 2 + (b * sigma[1]) ** 2 - 2 * a * b * rho * sigma[0] * sigma[1]
    )
    K = found["understeer_gradient_rad_s2_m"]
    assert K.value == pytest.approx(a * C[0] - b * C[1])
    assert (K.low, K.high) == pytest.approx((K.value - half, K.value + half))
    stiff = found["front_cornering_stiffness_n_rad"]
    wide = student.ppf(0.975, 23) * sigma[0]
    assert (stiff.value, stiff.low, stiff.high) == pytest.approx((1 / C[0], 1 / (C[0] + wide), 1 / (C[0] - wide)))


@pytest.mark.parametrize("rho", [0.0, 0.6])
def test_errors_correlated_between_windows_widen_the_interval(rho):
    """The mean of n windows with AR(1) errors has variance sigma^2 / n (1 + 2 sum of (1 - k / (M + 1)) rho^k)."""
    n, samples, rng = 600, 5, np.random.default_rng(3)
    slow = np.zeros(n)
    for k in range(1, n):
        slow[k] = rho * slow[k - 1] + sqrt(1 - rho**2) * rng.standard_normal()
    J, r = np.ones((n, samples, 1)), np.repeat(slow[:, None], samples, axis=1)
    found, _ = _bootstrap(J, r - r.mean(), np.array([[n * samples]], dtype=float), np.zeros(1))
    lags = np.arange(1, int(SLOW_S / WINDOW_S) + 1)
    wider = 1.0 + 2.0 * ((1 - lags / (lags[-1] + 1)) * rho**lags).sum()
    assert found[0, 0] * n / slow.var() == pytest.approx(wider, rel=0.2)


def logged(gap):
    """Return data of 62.5 s at 20 Hz without gyro values for `gap` [s] after 30 s, and the receiver's samples."""
    t = np.arange(0.0, 62.5, 0.05)
    rate = np.where((t > 30.0) & (t < 30.0 + gap), np.nan, np.degrees(0.2 * np.sin(t)))
    columns = {"t": t, "steer": np.degrees(0.2 * np.sin(t)), "speed": np.full(len(t), 1.5), "rate": rate}
    tables = {
        "time": {"column": "t"},
        "steer": {"column": "steer"},
        "speed": {"column": "speed"},
        "yaw_rate": {"column": "rate"},
    }
    return prepare([read_recording(pa.table(columns), LogMap.model_validate(tables), 2.0)], CHASSIS)


@pytest.mark.parametrize(("gap", "windows"), [(0.0, 12), (0.15, 12), (0.7, 11), (4.0, 10)])
def test_only_complete_windows_are_used_for_the_fit(gap, windows):
    """There are twelve windows of 5 s from 2 s on. The window from 27 to 32 s has a gap, and the next window
    has the longest gap."""
    data = logged(gap)
    assert data.windows == windows
    assert np.diff(data.channels["yaw_rate"].t, axis=1).max() < 0.5


def test_noise_model_is_autoregressive_and_finite_for_zero_residuals():
    """Windows follow x[k] = 0.6 x[k - 1] + 0.3 e[k]. For zero residuals, the result is finite."""
    e = 0.3 * np.random.default_rng(4).standard_normal((400, 60))
    x = np.zeros_like(e)
    for k in range(1, 60):
        x[:, k] = 0.6 * x[:, k - 1] + e[:, k]
    found = noise_of(x[:, 10:], 0.1)
    assert found.coefficients[:2] == pytest.approx([0.6, 0.0], abs=0.03)
    assert found.sigma == pytest.approx(0.3, rel=0.02)
    white = whiten(x[:, 10:], found)
    assert white.std() == pytest.approx(1.0, rel=0.02)
    assert abs(np.corrcoef(white[:, 1:].ravel(), white[:, :-1].ravel())[0, 1]) < 0.03
    assert not whiten(np.zeros((2, 50)), noise_of(np.zeros((2, 50)), 0.1)).any()


@pytest.mark.parametrize("rate_hz", [4.0, 10.0, 20.0])
def test_heading_noise_is_equal_at_samples_and_between_samples(rate_hz):
    """Otherwise, a fit prefers latencies at which positions depend on headings between samples."""
    t = np.arange(0.0, 1000.0, 1 / rate_hz)
    noise = TimeSeries(t, np.random.default_rng(5).standard_normal(len(t)))
    steps = np.arange(0.0, t[-1], STEP_S)
    heading = _smooth_heading(noise, steps)
    at, between = (np.interp(t[1:-1] + later, steps, heading).std() for later in (0.0, 0.5 / rate_hz))
    assert between == pytest.approx(at, rel=0.05)


def test_smoothed_heading_follows_quick_bends_of_a_machine():
    t = np.arange(0.0, 60.0, 0.25)
    steps = np.arange(2.0, 58.0, STEP_S)
    swings = 0.2 * np.sin(2 * np.pi * 0.4 * steps)
    found = _smooth_heading(TimeSeries(t, 0.2 * np.sin(2 * np.pi * 0.4 * t)), steps)
    assert np.abs(found - swings)[100:-100].max() < 0.02 * 0.2
