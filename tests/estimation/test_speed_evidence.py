"""Speed of `ekf_full`: limited wheel scale, signed speeds, and sensors that overrule the estimate."""

from math import cos, radians, sin

import numpy as np
import pytest
from recorded_drives import follow, nominal, record

from agrobot_mj.core.kernels import fetched
from agrobot_mj.core.signals import TICK_S, Fix, Quality
from agrobot_mj.estimation.ekf_full import EkfFull
from agrobot_mj.estimation.full_core import FOUND, Inputs, Seen, Smooth
from agrobot_mj.estimation.full_filter import step
from agrobot_mj.estimation.full_model import PSI, SCALE_LIMIT, K, V
from agrobot_mj.estimation.sideslip_noise import SidewaysNoise, density
from agrobot_mj.machine.tractor import TractorParameters

COURSE = 0.4


def aligned(v=1.0):
    """Return filter and aligned filter state of a tractor at a speed [m/s]."""
    state = EkfFull().init(0.0, 0.0, COURSE, TractorParameters())
    core = state.horizon.core
    mean, P = core.mean.copy(), core.covariance.copy()
    mean[V], P[PSI, PSI], P[V, V], P[K, K] = v, radians(0.5) ** 2, 1e-4, 1e-4
    return fetched(state.settings).filter, core._replace(
        mean=mean, covariance=P, search=FOUND, smooth=Smooth(cruise=v), seen=Seen(speed=v)
    )


def stepped(filter_, core, wheel, speed, ticks):
    """Return the filter state after ticks with constant measurements, and fixes at `speed` [m/s] along the course."""
    for k in range(ticks):
        t = core.seen.t + TICK_S if k else 1.0
        place = core.mean[0] + speed * TICK_S * cos(COURSE), core.mean[1] + speed * TICK_S * sin(COURSE)
        fix = Fix(*place, speed * cos(COURSE), speed * sin(COURSE))
        core = step(filter_, core, Inputs(t, 0.0, wheel, 0.0, 0.0, 0.0), fix, Quality.FIX, TICK_S)
    return core


def test_wheel_speed_with_the_wrong_sign_is_ignored():
    """The magnitudes 0.7 and 0.6 m/s agree, but the signs along the course do not."""
    filter_, core = aligned(0.7)
    after = stepped(filter_, core, wheel=-0.6, speed=0.7, ticks=200)
    assert after.mean[K] == pytest.approx(0.0, abs=0.05)
    assert after.mean[V] == pytest.approx(0.7, abs=0.05)


@pytest.mark.parametrize(("wheel", "limit"), [(0.6, -SCALE_LIMIT), (1.45, SCALE_LIMIT)])
def test_wheel_speed_scale_estimate_is_limited(wheel, limit):
    """A difference of 0.4 m/s between wheels and fixes passes the gate, and the scale reaches its limit."""
    filter_, core = aligned(1.0)
    core = core._replace(covariance=core.covariance + np.diag(np.eye(len(core.mean))[K]))
    after = stepped(filter_, core, wheel, 1.0, 400)
    assert after.mean[K] == pytest.approx(limit, abs=0.02)
    assert abs(after.mean[K]) <= SCALE_LIMIT
    assert after.mean[V] == pytest.approx(1.0, abs=0.15)


def test_agreeing_wheel_speed_and_fixes_overrule_the_speed_estimate():
    """Without a limit, the scale would become -3 to fit the wheel speed, and the speed would not change."""
    filter_, core = aligned(-0.5)
    core = core._replace(covariance=core.covariance + np.diag(4.0 * np.eye(len(core.mean))[K]))
    after = stepped(filter_, core, wheel=1.15, speed=1.05, ticks=20)
    assert after.mean[V] == pytest.approx(1.05, abs=0.1)
    assert after.mean[PSI] == pytest.approx(COURSE, abs=radians(2.0))
    assert abs(after.mean[K]) < SCALE_LIMIT


def test_white_position_noise_is_not_attributed_to_course_variation():
    rng, sigma, dt = np.random.default_rng(5), 0.02, 0.05
    white = SidewaysNoise()
    for e in sigma * rng.standard_normal(4000):
        white = white.after(e, sigma**2, dt)
    assert density(white) < sigma**2 * dt
    swaying, b, tau, s = SidewaysNoise(), 0.0, 1.0, 0.01
    densities = []
    for k in range(16000):
        b += -b * dt / tau + s * np.sqrt(2 * dt / tau) * rng.standard_normal()
        swaying = swaying.after(b + sigma * rng.standard_normal(), sigma**2, dt)
        if k > 2000:
            densities.append(density(swaying))
    assert 0.5 < np.mean(densities) / (2 * tau * s * s) < 1.2  # the low-pass filter attenuates the variation


def test_imu_lag_adds_no_heading_error_on_a_slope_at_speed():
    """On a figure-eight across 13 deg at 2.6 m/s, roll and pitch with half a second of lag would add 0.3 deg."""
    keys = {"terrain": {"kind": "slope", "grade_deg": 13.0}, "guidance.kind": "lqr", "path.speed_m_s": 2.6}
    full = {"kind": "ekf_full", "terrain_compensation": True}
    drive = record("figure_eight", {**keys, "physics": "fast", "estimator": full, "seed": 62}, 60.0)
    traces = [follow(drive, full, seed, nominal) for seed in (621, 622)]
    assert np.mean([np.mean(trace.heading_nees[trace.t > 20.0]) for trace in traces]) < 2.0
