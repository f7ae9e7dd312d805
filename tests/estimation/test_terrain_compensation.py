"""Compensation of antenna tilt: exact kinematics, and the MuJoCo tractor across and along a slope."""

from math import cos, hypot, nan, pi, radians, sin

import numpy as np
import pytest

from agrobot_mj import load_scenario, run
from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.core.kernels import fetched
from agrobot_mj.core.signals import Fix, Measurement, Quality
from agrobot_mj.estimation import Ekf, EkfBias
from agrobot_mj.estimation.lever_arm import Lever, at_foot, offset
from agrobot_mj.machine.tractor import TractorParameters

DT, TRACTOR = 0.05, TractorParameters()
PERFECT = {"enabled": True, "sigma_deg": 0.0, "wander_sigma_deg": 0.0}


def rotation(roll, pitch, yaw):
    """Return the product of the elementary rotations about x, y and z by the right-hand rule."""
    (a, b), (c, d), (e, f) = ((cos(angle), sin(angle)) for angle in (roll, pitch, yaw))
    about_x = np.array([[1, 0, 0], [0, a, -b], [0, b, a]])
    about_y = np.array([[c, 0, d], [0, 1, 0], [-d, 0, c]])
    about_z = np.array([[e, -f, 0], [f, e, 0], [0, 0, 1]])
    return about_z @ about_y @ about_x


@pytest.mark.parametrize("arm", [(0.0, 0.0, 2.0), (0.53, 0.0, 0.55), (0.1, -0.4, 0.3)])
@pytest.mark.parametrize("attitude", [(0.2, 0.0, 0.7), (0.0, -0.15, 2.0), (-0.3, 0.25, -2.9)])
def test_antenna_offset_equals_the_rotated_lever_arm(arm, attitude):
    assert offset(arm, *attitude) == pytest.approx((rotation(*attitude) @ arm)[:2], abs=1e-12)


def test_antenna_offsets_have_the_correct_signs():
    """With the left side up, the antenna moves to the right; with the nose down, it moves forward."""
    assert offset((0, 0, 2), 0.1, 0.0, 0.0) == pytest.approx((0.0, -2 * sin(0.1)))
    assert offset((0, 0, 2), 0.0, 0.1, 0.0) == pytest.approx((2 * sin(0.1), 0.0))
    assert offset((0, 0, 2), 0.1, 0.0, pi / 2) == pytest.approx((2 * sin(0.1), 0.0))


def test_antenna_velocity_correction_is_the_filtered_offset_rate():
    lever, last = Lever((0.0, 0.0)), None
    for k in range(100):
        last, lever = lever, lever.after((0.03 * k, -0.01 * k), DT, 0.1)
    assert lever.swing == pytest.approx((0.6, -0.2), rel=1e-6)
    assert last.after((1.0, 1.0), DT, 0.0).swing == pytest.approx(
        ((1.0 - last.offset[0]) / DT, (1.0 - last.offset[1]) / DT)
    )
    found = at_foot(Fix(1.0, 2.0, 3.0, 4.0, 5.0, 2.5, 0.7), Lever((0.1, 0.2), (0.3, 0.4)))
    assert found == (0.9, 1.8, 2.7, 3.6, 5.0, 2.5, 0.7)


@pytest.mark.parametrize("kind", [Ekf, EkfBias])
@pytest.mark.parametrize("yaw", [0.3, -2.0])
def test_position_of_a_rolling_and_pitching_tractor_is_accurate(kind, yaw):
    """Exact kinematics: straight motion while rolling and pitching, with noise-free antenna fixes."""

    def error(compensated):
        estimator, r = kind(terrain_compensation=compensated), np.zeros(2)
        state, worst = estimator.init(*r, yaw, TRACTOR), 0.0
        for k in range(1, 600):
            t = k * DT
            r = 1.2 * t * np.array([cos(yaw), sin(yaw)])
            roll, pitch = 0.17 + 0.05 * sin(t), -0.08 + 0.04 * sin(0.7 * t)
            R = rotation(roll, pitch, yaw)
            step = 1e-5
            later = rotation(0.17 + 0.05 * sin(t + step), -0.08 + 0.04 * sin(0.7 * (t + step)), yaw)
            swing = ((later - R) @ (0, 0, 2.0) / step)[:2]
            antenna, velocity = r + (R @ (0, 0, 2.0))[:2], 1.2 * np.array([cos(yaw), sin(yaw)]) + swing
            fix = Fix(*antenna, *velocity)
            measurement = Measurement(t, fix, Quality.FIX, 0.0, 0.0, 0.0, roll, pitch)
            state, estimate = estimator.update(state, measurement, DT)
            cg = r + (R @ (TRACTOR.cg_to_rear_axle, 0, TRACTOR.cg_height_m))[:2]
            if t > 10:
                worst = max(worst, hypot(estimate.rear_x - r[0], estimate.rear_y - r[1]))
                worst = max(worst, hypot(estimate.x - cg[0], estimate.y - cg[1]))
        return worst

    assert error(True) < 0.01
    assert error(False) > 0.3


@pytest.mark.parametrize("kind", [Ekf, EkfBias])
@pytest.mark.parametrize("attitude", [(0.2, nan), (nan, 0.2), (nan, nan)])
def test_roll_without_a_pitch_measurement_is_ignored(kind, attitude):
    """The CG offset then equals the offset on level ground, and the lever arm of the antenna does not change."""
    estimator = kind(terrain_compensation=True)
    state = estimator.init(1.0, 2.0, 0.5, TRACTOR)
    fix = Fix(1.0, 2.0, 0.0, 0.0)
    state, _ = estimator.update(state, Measurement(DT, fix, Quality.FIX, 0.0, 0.0, 0.0, 0.1, -0.1), DT)
    after, e = estimator.update(state, Measurement(2 * DT, None, Quality.NONE, 0.0, 0.0, 0.0, *attitude), DT)
    level = TRACTOR.cg_to_rear_axle * np.array([cos(e.yaw), sin(e.yaw)])
    assert (e.x - e.rear_x, e.y - e.rear_y) == pytest.approx(level)
    assert fetched(after.numbers).lever == fetched(state.numbers).lever


@pytest.mark.parametrize("heading_deg", [0.0, 90.0, 180.0, 270.0])
def test_cg_position_on_a_slope_is_accurate_at_any_heading(heading_deg):
    """The MuJoCo tractor drives east, uphill, west and downhill on a slope that rises by 10 deg to the north."""

    def error(compensated):
        log = run(
            load_scenario(
                "straight_line",
                {
                    "duration_s": 25.0,
                    "terrain": {"kind": "slope", "grade_deg": 10.0, "direction_deg": 90.0},
                    "path.heading_deg": heading_deg,
                    "sensors": {"gnss": {"sigma_m": 0.0, "velocity_sigma_m_s": 0.0}, "imu": PERFECT},
                    "estimator": {"kind": "ekf_bias", "terrain_compensation": compensated},
                },
            )
        )
        rest = slice(-200, None)
        return [
            float(np.mean((log.column(f"{name}_hat") - log.column(name))[rest]))
            for name in ("x", "y", "rear_x", "rear_y")
        ]

    east, north, rear_east, rear_north = error(True)
    crab = radians(1.5)  # unobservable heading error, which rotates both lever arms
    assert abs(rear_north) < 0.004
    assert abs(rear_east) < 2.0 * sin(radians(10.3)) * crab + 0.001
    assert max(abs(east), abs(north)) < TRACTOR.cg_to_rear_axle * crab + 0.004
    *_, lean_east, lean_north = error(False)
    assert lean_north == pytest.approx(-2.0 * sin(radians(10.3)), abs=0.02)
    assert abs(lean_east) < 0.02


def test_terrain_compensation_without_imu_is_rejected():
    with pytest.raises(ScenarioError, match=r"estimator\.terrain_compensation: needs sensors\.imu\.enabled"):
        load_scenario("straight_line", {"estimator.terrain_compensation": True})
