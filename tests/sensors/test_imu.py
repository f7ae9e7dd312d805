"""Inertial unit: errors as configured by its keys, without effect on the noise of other sensors."""

from math import atan, cos, degrees, exp, isnan, pi, radians, sin, sqrt, tan

import numpy as np
import pytest

from agrobot_mj import load_scenario, run
from agrobot_mj.core.geometry import wrap
from agrobot_mj.core.signals import NOMINAL, Truth
from agrobot_mj.sensors import Imu, Sensors

DT = 0.05


def truth(roll=0.0, pitch=0.0):
    return Truth(
        *(0.0, 0.0, 0.0, 0.5, 0.3, pitch, roll, 1.2, 0.0, 0.1, 0.1, 0.5, 0.3, 0.3),
        antenna=(0.0, 0.0, 2.0),
        antenna_velocity=(1.1, 0.4, 0.0),
        steer_samples=np.full(25, 0.1),
        pedal_samples=np.full(25, 0.5),
        body_rates=(0.0, 0.0, 0.0),
        rear_velocity=(1.15, 0.36, 0.0),
    )


def readings(imu, ticks, seed=1, roll=0.0, pitch=0.0):
    state, found = imu.init(seed), []
    for _ in range(ticks):
        state, measured = imu.measure(state, truth(roll, pitch), NOMINAL, DT)
        found.append(measured[:2])
    return np.degrees(found)


def drive(imu, motion, ticks, roll=0.0, pitch=0.0):
    """Return errors of roll and pitch [rad], and specific force, of a perfect unit after each tick of a planar motion.

    `motion` returns speed [m/s], yaw [rad] and yaw rate [rad/s] of R at a time.
    """
    state, found = imu.init(1), []
    for k in range(ticks):
        speed, yaw, rate = motion(k * DT)
        ahead, aside = cos(yaw), sin(yaw)
        now = truth(roll, pitch)._replace(
            speed=speed,
            yaw=wrap(yaw),
            yaw_rate=rate,
            body_rates=(-sin(pitch) * rate, sin(roll) * cos(pitch) * rate, cos(roll) * cos(pitch) * rate),
            rear_velocity=(speed * ahead, speed * aside, -tan(pitch) * speed),
        )
        state, read = imu.measure(state, now, NOMINAL, DT)
        found.append((read.roll - roll, read.pitch - pitch, *read[2:]))
    return np.array(found)


def perfect(**keys):
    return Imu(**{"enabled": True, "sigma_deg": 0.0, "wander_sigma_deg": 0.0, "up_m": 0.0, **keys})


def bend(speed, rate):
    return lambda t: (speed, rate * t, rate)


@pytest.mark.parametrize("way", [1, -1])
def test_unaided_inclinometer_reports_a_bend_as_tilt(way):
    """At 0.1 g the error is 5.7 deg, left side up in a left bend, also in reverse on the same circle."""
    speed = 4.2
    found = drive(perfect(aiding="none", time_constant_s=0.0), bend(speed * way, 0.981 / speed * way), 40)
    assert np.degrees(found[5:, 0]) == pytest.approx(np.degrees(atan(0.1)), rel=1e-4)
    assert found[5:, 1] == pytest.approx(0.0, abs=1e-4)
    assert found[5:, 2:] == pytest.approx(np.tile([0.0, 0.981, 9.81], (35, 1)), abs=1e-3)


def test_gyros_reduce_the_roll_and_pitch_error_in_a_bend():
    """The vertical of the filter is constant in space, so that the roll error decreases with tau r, and pitch lags."""
    tau, r = 2.0, 0.3
    found = drive(perfect(aiding="none", time_constant_s=tau), bend(3.0, r), 600)[-1]
    tilted = 0.9 / 9.81
    assert found[0] == pytest.approx(tilted / (1 + (tau * r) ** 2), rel=0.01)
    assert found[1] == pytest.approx(-tau * r * tilted / (1 + (tau * r) ** 2), rel=0.02)


@pytest.mark.parametrize("a", [0.8, -1.3])
def test_unaided_imu_reports_acceleration_as_pitch(a):
    """During acceleration, the measured pitch is nose up, with the configured time constant."""

    def speeding(t):
        return a * t, 0.4, 0.0

    assert drive(perfect(aiding="none", time_constant_s=0.0), speeding, 5)[-1, 1] == pytest.approx(-atan(a / 9.81))
    rising = drive(perfect(aiding="none", time_constant_s=1.5), speeding, 31)[:, 1]
    assert rising[-1] == pytest.approx(-a / 9.81 * (1 - exp(-1)), rel=1e-6)


@pytest.mark.parametrize("motion", [bend(2.5, -0.35), lambda t: (0.7 * t, 1.0, 0.0), bend(-1.5, 0.2)])
def test_speed_aiding_removes_the_effect_of_acceleration_on_tilt(motion):
    assert drive(perfect(time_constant_s=0.0), motion, 100)[:, :2] == pytest.approx(0.0, abs=1e-5)


@pytest.mark.parametrize("aiding", ["none", "speed"])
def test_slope_is_measured_exactly_when_driving_straight_at_constant_speed(aiding):
    lean, nose = radians(11.0), radians(-6.0)
    found = drive(perfect(aiding=aiding, up_m=1.7), lambda t: (1.8, 2.0, 0.0), 200, lean, nose)
    assert found[:, :2] == pytest.approx(0.0, abs=1e-12)
    along = 9.81 * np.array([-sin(nose), sin(lean) * cos(nose), cos(lean) * cos(nose)])
    assert found[-1, 2:] == pytest.approx(along)


@pytest.mark.parametrize("time_constant", [0.0, 2.5])
def test_vibration_biases_an_inclinometer_but_not_an_imu_with_gyros(time_constant):
    """In-phase vibration of 0.5 g up and 0.3 g back tilts the mean force by a_x a_z / g^2 / 2, that is 4 deg."""
    imu = perfect(aiding="none", time_constant_s=time_constant)
    state, pitch, w = imu.init(1), [], 2 * pi * 2.5
    for k in range(2000):
        swing = sin(w * k * DT) / w * 9.81
        state, read = imu.measure(
            state, truth()._replace(rear_velocity=(-0.3 * swing, 0.0, 0.5 * swing), yaw=0.0), NOMINAL, DT
        )
        pitch.append(degrees(read.pitch))
    mean = np.mean(pitch[400:])
    if time_constant:
        assert mean == pytest.approx(0.0, abs=0.02)
    else:
        assert mean < -3.0


def test_lever_arm_acceleration_in_roll_oscillation_adds_to_measured_roll():
    """A unit h above R with the roll angle a sin(w t) measures h a w^2 sin(w t) in addition to gravity."""
    h, a, w = 1.4, radians(2.0), 2 * pi * 0.5
    imu = perfect(time_constant_s=0.0, up_m=h)
    state, error = imu.init(1), []
    t = DT * np.arange(200)
    for now in t:
        roll = a * sin(w * now)
        state, read = imu.measure(state, truth(roll)._replace(body_rates=(a * w * cos(w * now), 0.0, 0.0)), NOMINAL, DT)
        error.append(read.roll - roll)
    felt = 2 * np.mean(error * np.sin(w * (t - DT / 2)))  # the mean of a tick belongs to its middle
    assert felt == pytest.approx(h * a * w**2 / 9.81, rel=0.02)


@pytest.mark.parametrize("plant", ["bicycle", "mujoco"])
def test_unaided_imu_reports_outward_tilt_in_a_bend_on_both_plants(plant):
    """On level ground, the roll error is a / g for the lateral acceleration a on the circle."""
    given = {
        "plant.kind": plant,
        "path.radius_m": 12.0,
        "path.speed_m_s": 2.0,
        "duration_s": 25.0,
        "sensors.imu": perfect(aiding="none", time_constant_s=0.0, up_m=0.5).model_dump(),
    }
    log = run(load_scenario("circle", given)).signals.slice(360).to_pydict()
    a = np.mean(log["speed"]) * np.mean(log["yaw_rate"])
    sign = np.sign(a)
    assert sign * (np.mean(log["imu_roll"]) - np.mean(log["roll"])) == pytest.approx(atan(abs(a) / 9.81), rel=0.05)
    assert np.mean(log["imu_force_y"]) == pytest.approx(a + 9.81 * np.sin(np.mean(log["roll"])), rel=0.05)
    assert np.mean(log["imu_force_z"]) == pytest.approx(9.81, abs=0.05)


def test_roll_and_pitch_measurements_are_nan_without_an_imu():
    sensors = Sensors()
    _, measurement = sensors.measure(sensors.init(1), truth(), NOMINAL, DT)
    assert isnan(measurement.roll)
    assert isnan(measurement.pitch)


def test_ideal_imu_measures_the_true_attitude():
    sensors = Sensors(imu=Imu(enabled=True, sigma_deg=0.0, wander_sigma_deg=0.0))
    _, measurement = sensors.measure(sensors.init(1), truth(roll=0.17, pitch=-0.05), NOMINAL, DT)
    assert (measurement.roll, measurement.pitch) == (0.17, -0.05)


def test_each_imu_bias_is_added_to_its_own_axis():
    imu = Imu(enabled=True, sigma_deg=0.0, wander_sigma_deg=0.0, roll_bias_deg=0.4, pitch_bias_deg=-0.3)
    assert readings(imu, 1, roll=radians(10.0), pitch=radians(2.0))[0] == pytest.approx([10.4, 1.7])


@pytest.mark.parametrize("lag", [0, 1, 5])
def test_imu_error_has_the_configured_sigmas_and_correlation_time(lag):
    n, imu = 40_000, Imu(enabled=True, sigma_deg=0.1, wander_sigma_deg=0.2, wander_time_s=0.25)
    error = readings(imu, n)
    expected = 0.04 * exp(-lag * DT / 0.25) + 0.01 * (lag == 0)
    for axis in error.T:
        assert axis[: n - lag] @ axis[lag:] / (n - lag) == pytest.approx(expected, abs=5 * 0.05 * sqrt(10 / n))
    assert abs(np.corrcoef(error.T)[0, 1]) < 5 * sqrt(10 / n)


def test_correlated_imu_error_starts_in_its_stationary_distribution():
    imu, n = Imu(enabled=True, sigma_deg=0.0, wander_sigma_deg=0.2), 2000
    first = [readings(imu, 1, seed)[0, 0] for seed in range(n)]
    assert np.std(first) == pytest.approx(0.2, rel=5 / sqrt(2 * n))


def test_imu_does_not_change_the_noise_of_other_sensors():
    with_it, without = Sensors(imu=Imu(enabled=True)), Sensors()
    states = [sensors.init(1) for sensors in (with_it, without)]
    for _ in range(20):
        states[0], one = with_it.measure(states[0], truth(), NOMINAL, DT)
        states[1], other = without.measure(states[1], truth(), NOMINAL, DT)
        assert one[:6] == other[:6]
        assert not isnan(one.roll)
