"""Heading from two antennas: errors, latency, and use by the estimator."""

from math import atan2, degrees, isnan, radians, sqrt

import numpy as np
import pytest

from agrobot_mj import load_scenario, run
from agrobot_mj.core.signals import NOMINAL, Quality, Truth
from agrobot_mj.sensors import DualAntenna, Gnss

DT = 0.05


def truth(yaw=0.3, roll=0.0, pitch=0.0, t=0.0):
    return Truth(
        *(t, 0.0, 0.0, 0.5, yaw, pitch, roll, 1.2, 0.0, 0.0, 0.1, 0.5, 0.3, 0.3),
        antenna=(0.0, 0.0, 2.0),
        antenna_velocity=(1.1, 0.4, 0.0),
        steer_samples=np.full(25, 0.1),
        pedal_samples=np.full(25, 0.5),
    )


def headings(dual, ticks, seed=1, now=truth(), quality=Quality.FIX, latency=0.0):
    gnss, found = Gnss(dual_antenna=dual, latency_s=latency), []
    state = gnss.init(seed)
    for _ in range(ticks):
        state, (fix, _) = gnss.measure(state, now, NOMINAL._replace(gnss_quality=quality), DT)
        found.append(fix.heading if fix else np.nan)
    return np.array(found)


def test_heading_is_missing_without_a_second_antenna():
    assert isnan(headings(DualAntenna(), 1)[0])


def test_dual_antenna_heading_needs_fixed_ambiguities():
    on = DualAntenna(enabled=True)
    assert np.isnan(headings(on, 5, quality=Quality.FLOAT)).all()
    assert np.isfinite(headings(on, 5)).all()


def test_dual_antenna_heading_needs_no_base_station():
    assert np.isfinite(headings(DualAntenna(enabled=True), 5, quality=Quality.DGPS)).all()


@pytest.mark.parametrize("baseline", [0.5, 2.0])
def test_heading_sigma_is_position_sigma_divided_by_the_baseline(baseline):
    dual, n = DualAntenna(enabled=True, baseline_m=baseline, wander_sigma_m=0.0, mounting_deg=0.5), 4000
    error = headings(dual, n) - 0.3
    assert error.std() == pytest.approx(0.003 / baseline, rel=5 / sqrt(2 * n))
    assert degrees(error.mean()) == pytest.approx(0.5, abs=5 * degrees(0.003 / baseline) / sqrt(n))


def test_correlated_heading_error_starts_in_its_stationary_distribution():
    dual, n = DualAntenna(enabled=True, sigma_m=0.0, wander_sigma_m=0.004), 1500
    error = np.array([headings(dual, 1, seed)[0] for seed in range(n)]) - 0.3
    assert error.std() == pytest.approx(0.004, rel=5 / sqrt(2 * n))


@pytest.mark.parametrize(("roll", "pitch"), [(0.2, 0.0), (0.0, 0.2), (0.2, 0.15), (-0.2, 0.15)])
def test_roll_and_pitch_rotate_the_antenna_baseline(roll, pitch):
    """The reference uses rotation matrices: yaw, then pitch, then roll (ISO 8855)."""
    c, s = np.cos, np.sin
    R_z = np.array([[c(0.3), -s(0.3), 0], [s(0.3), c(0.3), 0], [0, 0, 1]])
    R_y = np.array([[c(pitch), 0, s(pitch)], [0, 1, 0], [-s(pitch), 0, c(pitch)]])
    R_x = np.array([[1, 0, 0], [0, c(roll), -s(roll)], [0, s(roll), c(roll)]])
    left = R_z @ R_y @ R_x @ [0.0, 1.0, 0.0]
    perfect = DualAntenna(enabled=True, sigma_m=0.0, wander_sigma_m=0.0)
    expected = atan2(left[1], left[0]) - np.pi / 2
    assert headings(perfect, 1, now=truth(roll=roll, pitch=pitch))[0] == pytest.approx(expected, abs=1e-12)


def test_heading_arrives_with_its_fix_and_changes_no_other_noise():
    on = DualAntenna(enabled=True)
    assert np.array_equal(headings(on, 20)[:-4], headings(on, 20, latency=0.2)[4:])
    fixes = []
    for dual in (on, DualAntenna()):
        gnss = Gnss(dual_antenna=dual)
        state = gnss.init(2)
        for _ in range(20):
            state, (fix, _) = gnss.measure(state, truth(), NOMINAL, DT)
        fixes.append(fix[:6])
    assert fixes[0] == fixes[1]


FULL = {
    **{"estimator.kind": "ekf_full", "sensors.gyro.enabled": True, "sensors.wheel_speed.enabled": True},
    "guidance.kind": "lqr",
}
BOTH = {"sensors.gnss.dual_antenna.enabled": True}


def test_dual_antenna_corrects_a_wrong_initial_heading_at_standstill():
    """An initial heading error of 60 deg is corrected at once by two antennas, but only after some metres by one."""
    wrong = {**FULL, "estimator.initial_yaw_error_deg": 60, "duration_s": 0.5}
    for more, found in ((BOTH, True), ({}, False)):
        signals = run(load_scenario("straight_line", {**wrong, **more})).signals
        assert bool(signals["aligned"][-1].as_py()) == found
        off = abs(signals["yaw_hat"][-1].as_py() - signals["yaw"][-1].as_py())
        assert (degrees(off) < 1.5) == found


def test_dual_antenna_on_a_side_slope_separates_heading_from_course():
    """On 10 deg the crab angle exceeds one degree, which an estimator with one antenna interprets as heading."""
    slope = {**FULL, "duration_s": 40}
    off = {}
    for name, more in (("one", {}), ("two", BOTH)):
        table = run(load_scenario("side_slope_10", {**slope, **more})).signals
        signals = {column: table[column].to_numpy()[400:] for column in table.column_names}
        heading = signals["yaw_hat"] - signals["sideslip_hat"]
        off[name] = abs(degrees(np.mean(heading - signals["yaw"])))
        course = np.arctan2(np.diff(signals["rear_y"]), np.diff(signals["rear_x"]))
        assert abs(degrees(np.mean(signals["yaw_hat"][1:] - course))) < 0.4
    assert off["one"] > 0.8
    assert off["two"] < 0.35


def test_fix_with_an_invalid_heading_is_rejected():
    estimator = load_scenario("straight_line", FULL | BOTH).estimator
    scenario = load_scenario("straight_line", FULL | BOTH)
    state = estimator.init(0.0, 0.0, 0.0, scenario.tractor)
    sensors = scenario.sensors
    sensing = sensors.init(1)
    for k in range(60):
        now = truth(0.0, t=DT * k)._replace(antenna_velocity=(0.0, 0.0, 0.0), wheel_speed=0.0)
        sensing, measured = sensors.measure(sensing, now, NOMINAL, DT)
        if k > 30:
            measured = measured._replace(fix=measured.fix._replace(heading=radians(90.0)))
        state, _ = estimator.update(state, measured, DT)
    assert abs(degrees(state.horizon.core.mean[2])) < 2.0
