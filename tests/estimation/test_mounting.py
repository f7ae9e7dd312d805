"""Mounting error of two antennas in `ekf_full`: estimated on level ground, and not confused with sideslip."""

from math import cos, degrees, radians, sin

import numpy as np
import pytest
from recorded_drives import SLOPE, follow, nominal, record

from agrobot_mj.core.signals import TICK_S, Fix
from agrobot_mj.estimation.full_core import FOUND, Core, Smooth
from agrobot_mj.estimation.full_model import BETA, MOUNT, PSI, N, SideLoad, V
from agrobot_mj.estimation.mounting import WINDOW_S, with_crab, with_mounting

TWO = {"sensors.gnss.dual_antenna.enabled": True, "physics": "fast", "guidance.kind": "stanley"}
FULL = {"kind": "ekf_full"}


def followed(scenario, mounting_deg, **keys):
    """Return the trace of `ekf_full` in a run of 25 s with two antennas."""
    over = {**TWO, **keys, "estimator": FULL, "sensors.gnss.dual_antenna.mounting_deg": mounting_deg, "seed": 61}
    return follow(record(scenario, over, 25.0), FULL, 612, nominal)


def straight(crab, v=1.5, bend=0.0, seconds=6.0):
    """Return the filter state after fixes whose course differs from their heading by `crab` [rad]."""
    mean = np.zeros(N + 2)
    mean[V], mean[PSI] = v, 0.3
    core = Core(mean, np.diag(np.full(N + 2, 1e-4)), search=FOUND, smooth=Smooth(bend=bend))
    course = 0.3 + crab
    fix = Fix(0.0, 0.0, v * cos(course), v * sin(course), heading=0.3)
    for _ in range(round(seconds / TICK_S)):
        crab = with_crab(core, fix, SideLoad(bend=bend), TICK_S)
        mean, P, crab = with_mounting(core.mean, core.covariance, crab, bend)
        core = core._replace(mean=mean, covariance=P, crab=crab)
    return core


@pytest.mark.parametrize("mounting_deg", [-5.5, 3.7, 13.0])
def test_antenna_mounting_error_is_estimated_on_level_ground(mounting_deg):
    trace = followed("straight_line", mounting_deg)
    assert degrees(abs(np.mean(trace.heading[trace.t > 15.0]))) < 0.6


def test_crab_angle_on_a_side_slope_is_estimated_as_sideslip():
    """On 10 deg without an IMU, the crab angle is 1.4 deg; as a mounting error it would cause a heading error."""
    trace = followed("side_slope", 0.0, **SLOPE)
    assert degrees(abs(np.mean(trace.heading[trace.t > 15.0]))) < 0.35


@pytest.mark.parametrize("v", [1.5, -0.9])
def test_large_constant_crab_angle_is_attributed_to_antenna_mounting(v):
    core = straight(radians(-7.0), v=v)
    assert degrees(core.mean[MOUNT]) == pytest.approx(7.0, abs=1e-6)
    assert degrees(core.mean[PSI] - 0.3) == pytest.approx(-7.0, abs=1e-6)
    assert core.mean[BETA] == 0.0
    assert core.covariance[MOUNT, MOUNT] > radians(5.0) ** 2


@pytest.mark.parametrize(
    ("crab_deg", "bend", "seconds"),
    [(2.5, 0.0, 20.0), (5.0, 0.1, 20.0), (8.0, 0.0, 0.8 * WINDOW_S)],
    ids=["slope", "bend in ruts", "too short"],
)
def test_small_or_brief_crab_angle_is_not_a_mounting_error(crab_deg, bend, seconds):
    assert straight(radians(crab_deg), bend=bend, seconds=seconds).mean[MOUNT] == 0.0


@pytest.mark.parametrize(
    ("rate_deg_s", "seconds"),
    [(7.0, 20.0), (2.0, 12.0), (-1.0, 20.0)],
    ids=["arc", "wide arc", "gentle bend to the right"],
)
def test_frozen_heading_in_a_bend_is_not_a_mounting_error(rate_deg_s, seconds):
    """The course turns while the receiver repeats one heading."""
    mean = np.zeros(N + 2)
    mean[V] = 1.5
    core = Core(mean, np.diag(np.full(N + 2, 1e-4)), search=FOUND)
    for k in range(round(seconds / TICK_S)):
        course = radians(rate_deg_s) * k * TICK_S
        fix = Fix(0.0, 0.0, 1.5 * cos(course), 1.5 * sin(course), heading=0.0)
        core = core._replace(crab=with_crab(core, fix, SideLoad(), TICK_S))
        found, _, _ = with_mounting(core.mean, core.covariance, core.crab, 0.0)
        assert found[MOUNT] == 0.0, k * TICK_S


@pytest.mark.parametrize("mounting_deg", [-4.0, 24.0])
def test_mounting_error_is_estimated_on_rough_ground(mounting_deg):
    trace = followed("figure_eight", mounting_deg, terrain={"kind": "rough", "iso_class": "D"})
    assert degrees(abs(np.mean(trace.heading[trace.t > 15.0]))) < 1.0
