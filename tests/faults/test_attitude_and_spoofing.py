"""Faults of the inertial unit, spoofing of position and velocity, and the rate of a receiver."""

import numpy as np
import pytest

from agrobot_mj import Simulation, load_scenario, run
from agrobot_mj.core.errors import ScenarioError

UNIT = {
    "plant.kind": "mujoco",
    "physics": "fast",
    "duration_s": 12.0,
    "supervisor.enabled": False,
    "sensors.imu.enabled": True,
    "sensors.gyro.enabled": True,
    "sensors.wheel_speed.enabled": True,
    "estimator.kind": "ekf_full",
    "estimator.terrain_compensation": True,
    "terrain": {"kind": "slope", "grade_deg": 7.0, "direction_deg": 25.0},
}


def columns(fault, *names, **more):
    log = run(load_scenario("circle", UNIT | more | {"fault": [fault] if fault else []}))
    return [log.column(name) for name in names]


STILL = {"estimator.terrain_compensation": False}
"""Keys with which a fault of the inertial unit does not change the motion, because the estimator ignores the unit."""


@pytest.fixture(scope="module")
def sound():
    """Return time, roll and pitch without a fault."""
    return dict(zip(("t", "roll", "pitch"), columns(None, "t", "imu_roll", "imu_pitch", **STILL), strict=True))


@pytest.mark.parametrize("axis", ["roll", "pitch"])
@pytest.mark.parametrize(
    ("keys", "expected"),
    [
        ({"effect": "bias", "bias_deg": -4.0}, lambda sound, t: sound - np.radians(4.0)),
        ({"effect": "bias", "bias_deg": 6.0, "ramp_s": 3.0}, lambda sound, t: sound + np.radians(2.0) * (t - 5.0)),
        ({"effect": "scale", "scale": 1.4}, lambda sound, t: 1.4 * sound),
        ({"effect": "stuck", "value": "zero"}, lambda sound, t: 0.0 * sound),
        ({"effect": "loss"}, lambda sound, t: np.nan * sound),
    ],
)
def test_fault_of_one_imu_axis_changes_that_axis_only(sound, axis, keys, expected):
    keys, other = dict(keys), "pitch" if axis == "roll" else "roll"
    name, t, right = f"imu_{axis}", sound["t"], sound[axis]
    fault = {"kind": f"{name}_{keys.pop('effect')}", "start_s": 5.0, "end_s": 8.0, **keys}
    faulty, faulty_other = columns(fault, name, f"imu_{other}", **STILL)
    during = (t > 5.01) & (t < 7.99)
    assert faulty[during] == pytest.approx(expected(right[during], t[during]), abs=2e-3, nan_ok=True)
    assert np.array_equal(faulty_other, sound[other])
    assert np.array_equal(faulty[t < 4.99], right[t < 4.99])


def test_stuck_roll_sensor_repeats_its_last_measurement():
    (roll,) = columns({"kind": "imu_roll_stuck", "start_s": 6.0}, "imu_roll")
    assert len(set(roll[121:].tolist())) == 1
    assert len(set(roll[:119].tolist())) > 100


@pytest.mark.parametrize("estimator", ["ekf", "ekf_bias", "ekf_full"])
@pytest.mark.parametrize("axis", ["roll", "pitch"])
def test_estimators_continue_after_losing_roll_or_pitch(estimator, axis):
    fault = {"kind": f"imu_{axis}_loss", "start_s": 3.0}
    x, y, x_hat, y_hat = columns(fault, "x", "y", "x_hat", "y_hat", **{"estimator.kind": estimator})
    assert len(x) == 240
    assert np.hypot(x - x_hat, y - y_hat)[60:].max() < 0.4


def test_spoofed_velocity_contains_the_rate_of_the_position_drift():
    drift = {"kind": "gnss_drift", "start_s": 0.0, "east_m_s": 0.2, "north_m_s": -0.1, "velocity": "drifting"}
    fixes = []
    for faults in ([], [drift], [{**drift, "velocity": "sound"}]):
        sim = Simulation(load_scenario("circle", UNIT | {"fault": faults}))
        fixes.append(sim.reset().fix)
    sound, drifting, slipped = fixes
    assert (drifting.vx - sound.vx, drifting.vy - sound.vy) == pytest.approx((0.2, -0.1))
    assert (slipped.vx, slipped.vy) == (sound.vx, sound.vy)
    assert (drifting.x, drifting.y) == (slipped.x, slipped.y)


@pytest.mark.parametrize("rate_hz", [20, 10, 4, 2.5])
def test_receiver_delivers_solutions_at_its_configured_rate(rate_hz):
    rate = {"sensors.gnss.rate_hz": rate_hz}
    (sound,) = columns(None, "gnss_z")
    (z,) = columns(None, "gnss_z", **rate)
    every = round(20 / rate_hz)
    assert np.isfinite(z).sum() == -(-240 // every)
    assert np.isfinite(z[::every]).all()
    assert z[0] == sound[0]


def test_receiver_rate_that_does_not_divide_the_tick_rate_is_rejected():
    with pytest.raises(ScenarioError, match=r"sensors\.gnss\.rate_hz: .*whole ticks of 0\.05 s, got 8"):
        load_scenario("circle", {"sensors.gnss.rate_hz": 8})
