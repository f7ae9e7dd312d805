"""Dead reckoning of the supervisor: detection of faulty fixes, and consistency of the standard deviation."""

from math import atan, cos, inf, nan, pi, radians, sin
from types import SimpleNamespace

import numpy as np
import pytest

from agrobot_mj.control.evidence import sensor_numbers
from agrobot_mj.control.reckoning import MEMORY_S, Reckoning
from agrobot_mj.core.signals import TICK_S, Fix, Measurement, Quality
from agrobot_mj.machine.implements import TowedImplement
from agrobot_mj.machine.tractor import GRAVITY, TractorParameters

SPEED, RADIUS = 1.3, 11.0
TRACTOR = TractorParameters()
LIMIT = 5.0


def drive(
    seconds=90.0,
    seed=1,
    every=1,
    late=0,
    bias_deg_s=0.25,
    roll=0.0,
    fault=lambda t, fix: fix,
    wheel=lambda t: 1.0,
    lost=lambda t: False,
    dual=False,
    slip_deg=lambda t, swing: 0.0,
    weight=lambda t: nan,
    hitched=TowedImplement(),
    known=None,
    quality=lambda t: Quality.FIX,
):
    """Return ratios of distance to standard deviation, with their times, on straights of 20 s and half circles.

    There is a fix every `every` ticks, delayed by `late` ticks. `wheel` scales the wheel speed. `hitched` is the
    towed implement, and `known` the implement that the supervisor assumes; the sideslip `slip_deg` depends on the angle
    of the implement. `weight` is the vertical specific force divided by g, and `quality` is the quality of the fixes.
    """
    noise = np.random.default_rng(seed)
    x = y = yaw = wander = swing = 0.0
    state, places, ratios, times = Reckoning(), [], [], []
    for k in range(round(seconds / TICK_S)):
        t, rate = k * TICK_S, SPEED / RADIUS if (k * TICK_S) % (20.0 + pi * RADIUS / SPEED) > 20.0 else 0.0
        course = yaw + 0.5 * rate * TICK_S + radians(slip_deg(t, swing))
        x, y, yaw = x + SPEED * TICK_S * cos(course), y + SPEED * TICK_S * sin(course), yaw + rate * TICK_S
        if hitched.length:
            swing -= (rate + SPEED * sin(swing) / hitched.length) * TICK_S
        wander = 0.99833 * wander + 0.00063 * noise.standard_normal()
        east, north = 0.016 * noise.standard_normal(2) + wander
        east, north = east - hitched.antenna * cos(yaw + swing), north - hitched.antenna * sin(yaw + swing)
        vx, vy = SPEED * cos(yaw), SPEED * sin(yaw)
        heading = yaw + radians(0.3) * noise.standard_normal() if dual else nan
        places.append(Fix(x + east, y + north, vx, vy, t, heading=heading))
        fix = fault(t, places[k - late]) if k % every == 0 and k >= late else None
        gyro = nan if lost(t) else rate + radians(bias_deg_s + 0.1 * noise.standard_normal())
        steer = atan(rate * TRACTOR.wheelbase_m / SPEED) + radians(1.5)
        wheels = 1.03 * SPEED * wheel(t) + 0.02 * noise.standard_normal()
        measured = Measurement(t, fix, quality(t), steer, 0.3, gyro, roll, roll, wheels)
        force = SimpleNamespace(force_z=GRAVITY * weight(t))
        measured = measured._replace(readings={"imu": force})
        state = state.after(*sensor_numbers(measured), TRACTOR, False, TICK_S, hitched if known is None else known)
        ratios.append(state.distance / state.sigma)
        times.append(t)
    return np.nan_to_num(np.array(ratios)), np.array(times)


def detection_time(start, **more):
    """Return the time from `start` [s] to the first distance above the limit, or infinity."""
    ratios, times = drive(**more)
    assert ratios[times < start].max() < LIMIT
    late = times[(times >= start) & (ratios > LIMIT)]
    return float(late[0]) - start if late.size else inf


@pytest.mark.parametrize("every", [1, 2, 4, 20])
@pytest.mark.parametrize("roll", [0.0, nan], ids=["inertial unit", "no inertial unit"])
def test_fault_free_fixes_stay_within_the_expected_deviation(every, roll):
    worst = [drive(seconds=160.0, seed=seed, every=every, roll=roll)[0].max() for seed in (3, 4, 5)]
    assert max(worst) < 3.5


@pytest.mark.parametrize("bias_deg_s", [-0.4, 0.0, 0.4])
def test_delayed_fixes_and_gyro_bias_cause_no_false_alarm(bias_deg_s):
    ratios, _ = drive(late=6, bias_deg_s=bias_deg_s)
    assert ratios.max() < 3.5


@pytest.mark.parametrize(("rate", "within_s"), [(0.07, 9.0), (0.15, 4.0), (0.4, 2.0)])
@pytest.mark.parametrize("angle", [0.4, 1.7, 3.0])
def test_consistent_drift_of_position_and_velocity_is_detected(rate, within_s, angle):
    east, north, start = rate * cos(angle), rate * sin(angle), 42.0

    def slide(t, fix):
        s = max(fix.t - start, 0.0)
        return fix._replace(x=fix.x + east * s, y=fix.y + north * s) if s else fix

    assert detection_time(start, fault=slide, roll=0.0) < within_s + 2.0 * (angle == 3.0)


@pytest.mark.parametrize("gap_s", [0.35, 0.8, 3.0])
def test_position_jump_during_a_gap_is_detected_at_the_first_fix(gap_s):
    def jump(t, fix):
        return None if 50.0 <= t < 50.0 + gap_s else fix._replace(y=fix.y + 0.8 * (t > 50.0))

    assert detection_time(50.0, fault=jump, roll=0.0) < gap_s + 0.55


def test_position_jump_is_reported_until_all_older_fixes_have_expired():
    ratios, times = drive(seconds=120.0, fault=lambda t, fix: fix._replace(x=fix.x - 0.7 * (t > 55.0)), roll=0.0)
    assert (ratios[(times > 55.6) & (times < 55.0 + MEMORY_S - 6.0)] > LIMIT).all()
    assert (ratios[times > 55.0 + 2 * MEMORY_S] < LIMIT).all()


def test_wheel_spin_causes_no_false_alarm():
    ratios, _ = drive(wheel=lambda t: 1.8 if 40.0 < t < 48.0 else 1.0, roll=0.0)
    assert ratios.max() < LIMIT


@pytest.mark.parametrize("dual", [True, False], ids=["two antennas", "steering angle"])
def test_gyro_loss_causes_no_alarm_and_drift_remains_detectable(dual):
    def slide(t, fix):
        s = max(fix.t - 52.0, 0.0)
        return fix._replace(x=fix.x + 0.1 * s, y=fix.y - 0.1 * s) if s else fix

    lost = {"lost": lambda t: 52.0 < t < 58.0, "dual": dual, "roll": 0.0}
    assert max(drive(seed=seed, **lost)[0].max() for seed in (1, 2)) < 4.0
    assert detection_time(52.0, fault=slide, **lost) < (6.0 if dual else 25.0)


def test_dual_antenna_detects_slow_drift_long_after_gyro_loss():
    def slide(t, fix):
        return fix._replace(y=fix.y + 0.07 * max(fix.t - 41.0, 0.0))

    assert detection_time(41.0, fault=slide, lost=lambda t: t > 40.0, dual=True, roll=0.0, seconds=80.0) < 14.0


@pytest.mark.parametrize("loose", [Quality.FLOAT, Quality.DGPS])
def test_float_and_dgps_fixes_have_separate_permitted_deviations(loose):
    """A slowly varying float error is accepted; a steadily increasing error and a jump by metres are detected."""

    def quality(t):
        return Quality.FIX if t < 37.0 or t > 81.0 else loose

    def wandering(t, fix, slide=0.0):
        if quality(fix.t) == Quality.FIX:
            return fix
        s = fix.t - 37.0
        return fix._replace(x=fix.x + 0.4 * sin(s / 5.0) + slide * s, y=fix.y + 0.35 * cos(s / 8.0) - slide * s)

    assert max(drive(seed=seed, fault=wandering, quality=quality, roll=0.0)[0].max() for seed in (1, 2)) < LIMIT
    assert detection_time(37.0, fault=lambda t, fix: wandering(t, fix, 0.2), quality=quality, roll=0.0) < 15.0

    def jump(t, fix):
        return wandering(t, fix)._replace(x=fix.x + 2.6) if 52.0 < fix.t < 81.0 else wandering(t, fix)

    assert detection_time(52.0, fault=jump, quality=quality, roll=0.0) < 1.0


def test_dead_reckoning_requires_a_gyro_and_a_first_rtk_fix():
    state = Reckoning()
    for k in range(200):
        measured = Measurement(k * TICK_S, Fix(k * 0.06, 0.0, 1.2, 0.0), Quality.FIX, 0.0, 0.3, nan, wheel_speed=1.2)
        state = state.after(*sensor_numbers(measured), TRACTOR, False, TICK_S, TowedImplement())
    assert state.distance != state.distance
    for k in range(200, 400):
        measured = Measurement(k * TICK_S, Fix(k * 0.06, 0.0, 1.2, 0.0), Quality.FLOAT, 0.0, 0.3, 0.0, wheel_speed=1.2)
        state = state.after(*sensor_numbers(measured), TRACTOR, False, TICK_S, TowedImplement())
    assert state.references is None


def test_lateral_implement_pull_in_turns_causes_no_false_alarm():
    """In half circles, the implement force causes an inward sideslip of 1.6 deg."""
    implement, pulled = (
        TowedImplement(length=2.6, working=True),
        {"slip_deg": lambda t, swing: -7.0 * sin(swing), "roll": 0.0},
    )
    runs = {"hitched": implement, "seconds": 140.0, **pulled}
    assert max(drive(seed=seed, **runs)[0].max() for seed in (1, 2)) < 4.0
    assert min(drive(seed=seed, **runs, known=TowedImplement())[0].max() for seed in (1, 2)) > LIMIT


def test_antenna_on_towed_implement_causes_no_false_alarm_in_turns():
    implement = TowedImplement(length=2.2, antenna=2.8)
    runs = {"hitched": implement, "seconds": 140.0, "roll": 0.0}
    assert max(drive(seed=seed, **runs)[0].max() for seed in (1, 2)) < 4.0
    assert min(drive(seed=seed, **runs, known=TowedImplement())[0].max() for seed in (1, 2)) > LIMIT


def test_sideslip_is_accepted_while_wheel_loads_vary():
    """A tractor hopping on ridges may slide 6 deg for 4 s; the same slide with constant wheel loads is detected."""

    def slip(t, swing):
        return 6.0 if 46.0 < t < 50.0 else 0.0

    def hopping(t):
        return 1.0 + 0.9 * cos(2 * pi * 3.7 * t) if 40.0 < t < 52.0 else 1.0

    slides = {"slip_deg": slip, "seconds": 60.0, "roll": 0.0}
    assert max(drive(seed=seed, weight=hopping, **slides)[0].max() for seed in (1, 2)) < LIMIT
    assert min(drive(seed=seed, weight=lambda t: 1.0, **slides)[0].max() for seed in (1, 2)) > LIMIT
