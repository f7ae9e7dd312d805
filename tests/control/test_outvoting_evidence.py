"""Supervisor checks that use no single fix: inertial unit, wheel speed against fix speed, approach to the path."""

from math import nan, radians, sin
from types import SimpleNamespace

import numpy as np
import pytest
from test_supervisor import ROUTE, TICK

from agrobot_mj.control.base import Situation
from agrobot_mj.control.evidence import AttitudeEvidence, Evidence, drift_of, sensor_numbers, tilt_error
from agrobot_mj.control.supervisor import Mode, Supervisor
from agrobot_mj.core.signals import Command, Estimate, Fix, Measurement, Quality, Reference
from agrobot_mj.machine.tractor import TractorParameters


def attitude(angles, forces=None, moving=True):
    """Return the attitude evidence after pairs of roll and pitch [deg]; `forces` [deg] are the tilts of the forces."""
    evidence = AttitudeEvidence()
    for k, (roll, pitch) in enumerate(angles):
        readings = {}
        if forces is not None:
            side, ahead = (radians(angle) for angle in forces[k])
            readings["imu"] = SimpleNamespace(force_x=-9.81 * sin(ahead), force_y=9.81 * sin(side), force_z=9.6)
        measured = Measurement(k * TICK, None, 0, 0.0, 0.2, 0.0, radians(roll), radians(pitch), 0.9, readings=readings)
        evidence = evidence.after(sensor_numbers(measured)[0], moving, TICK)
    return evidence


def test_stuck_angle_sensor_is_distinguished_from_constant_angle():
    noise = np.random.default_rng(2).normal(0.0, 0.1, (60, 2))
    stuck = noise.copy()
    stuck[40:, 0] = stuck[40, 0]
    assert max(attitude(noise.tolist()).repeats) == 0.0
    assert max(attitude(stuck.tolist()).repeats) == pytest.approx(19 * TICK)
    assert max(attitude(stuck.tolist(), moving=False).repeats) == 0.0
    assert max(attitude([[0.0, 0.0]] * 60).repeats) == 0.0


def test_missing_angle_is_a_fault_only_after_the_first_measurement():
    assert attitude([[nan, nan]] * 50).silent_s == 0.0
    assert attitude([[1.0, 2.0]] * 10 + [[nan, 2.0]] * 30).silent_s == pytest.approx(30 * TICK)
    assert attitude([[1.0, 2.0]] * 10 + [[nan, 2.0]] * 30 + [[1.0, 2.0]]).silent_s == 0.0


@pytest.mark.parametrize("axis", [0, 1])
def test_drift_of_imu_angle_relative_to_the_accelerometer_is_detected(axis):
    creep = [[0.4 * k * TICK * (a == axis) for a in (0, 1)] for k in range(600)]
    level = [[0.0, 0.0]] * 600
    assert np.degrees(tilt_error(attitude(creep, level))) > 9.0
    assert np.degrees(tilt_error(attitude(creep, creep))) < 0.5
    assert tilt_error(attitude(creep)) == 0.0


def test_vertical_vibration_is_not_interpreted_as_tilt():
    """Forward and vertical forces are in phase: the mean of their tilts is 12 deg, the tilt of their mean is 0."""
    t = TICK * np.arange(400)
    evidence, tilts = AttitudeEvidence(), []
    for now in t.tolist():
        x, z = 4.0 * sin(20.1 * now), 9.81 - 9.0 * sin(20.1 * now)
        readings = {"imu": SimpleNamespace(force_x=-x, force_y=0.0, force_z=z)}
        measured = Measurement(now, None, 0, 0.0, 0.2, 0.0, 0.0, 0.0, 2.5, readings=readings)
        evidence = evidence.after(sensor_numbers(measured)[0], True, TICK)
        tilts.append(np.degrees(np.arctan2(x, z)))
    assert abs(np.mean(tilts)) > 8.0
    assert np.degrees(tilt_error(evidence)) < 3.0


def situations(speeds, offsets):
    """Yield situations with the given estimated speeds [m/s] and distances from the path [m]."""
    for k, (speed, offset) in enumerate(zip(speeds, offsets, strict=True)):
        estimate = Estimate(1.0, offset, 0.0, speed, 0.0, 0.5, offset, np.eye(3), fix_age=0.0, nis_mean=2.0)
        reference = Reference(1.0, 0.0, 1.2, 0.0, 0.0, 0.0)
        yield Situation(k * TICK, estimate, reference, ROUTE, TractorParameters(), 0.0)


def supervised(speeds, offsets, wheel=nan, fixes=0.0):
    """Return the supervisor state after situations with wheel and fix speeds [m/s], for a command of 1 m/s."""
    supervisor = Supervisor()
    state = supervisor.init()
    noise = np.random.default_rng(5)
    for k, situation in enumerate(situations(speeds, offsets)):
        fix = Fix(fixes * k * TICK + 0.005 * noise.standard_normal(), 0.0, fixes, 0.0, k * TICK)
        measured = Measurement(k * TICK, fix, Quality.FIX, 0.0, 0.2, nan, wheel_speed=wheel)
        state, _ = supervisor.update(state, situation, measured, Command(0.0, 1.0), 0.2, TICK)
    return state


@pytest.mark.parametrize(
    ("estimate", "wheel", "fixes", "word"),
    [
        (1.0, 1.7, 1.6, "above the command"),
        (-0.3, 1.1, 1.05, "below wheels and fixes"),
        (1.0, 1.04, 1.0, ""),
        (1.0, 2.4, 1.0, ""),
        (1.0, nan, 1.3, ""),
    ],
)
def test_agreeing_wheel_speed_and_gnss_overrule_the_estimated_speed(estimate, wheel, fixes, word):
    state = supervised([estimate] * 60, [0.0] * 60, wheel, fixes)
    assert (word in state.reason) if word else state.mode is Mode.TRACKING


def test_supervisor_stops_a_tractor_that_stops_approaching_its_path():
    coming = np.linspace(4.0, 0.0, 400).tolist()
    assert supervised([1.0] * 400, coming).mode is Mode.TRACKING
    leaving = [*np.linspace(3.0, 2.5, 100).tolist(), *np.linspace(2.5, 4.1, 100).tolist()]
    assert "m off the path" in supervised([1.0] * 200, leaving).reason
    again = [*np.linspace(3.0, 0.5, 200).tolist(), *np.linspace(0.5, 2.2, 100).tolist()]
    assert "2.01 m off the path" in supervised([1.0] * 300, again).reason
    assert "no closer to the path" in supervised([1.0] * 500, [3.0] * 500).reason


def drift(every, quality=lambda k: Quality.FIX, rate=0.0, gap=lambda k: False):
    """Return the maximum drift [m] within 60 s, with a fix every `every` ticks."""
    evidence, noise, maximum = Evidence(), np.random.default_rng(9), 0.0
    for k in range(1200):
        east, north, ve, vn = (s * v for s, v in zip((0.02, 0.02, 0.03, 0.03), noise.standard_normal(4), strict=True))
        if k % every or gap(k):
            continue
        t = k * TICK
        fix = Fix(1.1 * t + east, rate * t + north + (0.4 if quality(k) != Quality.FIX else 0.0), 1.1 + ve, vn, t)
        evidence = evidence.after(*sensor_numbers(Measurement(t, fix, quality(k), 0.0, 0.2, nan)))
        maximum = max(maximum, drift_of(evidence))
    return maximum


def test_position_drift_is_detected_across_gaps_and_float_solutions():
    assert max(drift(1), drift(4)) < 0.25
    assert drift(1, rate=0.015) > 0.4
    assert drift(1, rate=0.02, gap=lambda k: k % 80 < 14) > 0.5
    flicker = lambda k: Quality.FIX if k % 50 < 25 else Quality.FLOAT  # noqa: E731
    assert drift(1, flicker) < 0.25
    assert drift(1, flicker, rate=0.015) > 0.4
