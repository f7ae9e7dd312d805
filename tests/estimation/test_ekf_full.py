"""`ekf_full` on recorded runs of the MuJoCo tractor: accuracy, delayed fixes, losses, alignment, gates."""

from math import cos, degrees, isfinite, nan, radians, sin

import numpy as np
import pytest
from recorded_drives import (
    BIAS,
    FULL,
    PAPER,
    SLOPE,
    TILT,
    alignment,
    end,
    follow,
    late,
    loss,
    outlier,
    record,
    rms,
    whole,
)

from agrobot_mj import load_scenario
from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.core.kernels import fetched
from agrobot_mj.core.randomness import stream
from agrobot_mj.core.signals import NOMINAL, Fix, Measurement, Quality
from agrobot_mj.estimation import EkfFull
from agrobot_mj.estimation.full_core import forget_correlated
from agrobot_mj.estimation.full_model import B_G, B_S, G_E, G_N, OMEGA, PSI, C, K, S, X, Y
from agrobot_mj.machine.tractor import TractorParameters
from agrobot_mj.simulation.stepping import Simulation

DT, TRACTOR = 0.05, TractorParameters()


@pytest.fixture(scope="module")
def drive():
    """Return a run of 48 s of a figure-eight on level ground with magic-formula tyres."""
    return record("figure_eight", {}, 48.0)


def simulated(estimator, duration, speed=1.2, turn=0.1, yaw=0.3, initial_yaw=0.3, seed=1, changed=lambda t, m: m):
    """Run the estimator on exact arcs at R with white noise, altered by `changed`; return states, estimates and true
    poses."""
    rng, (x, y) = stream(seed, "test"), (0.0, 0.0)
    state, found = estimator.init(x, y, initial_yaw, TRACTOR), []
    for k in range(round(duration / DT)):
        u, w = speed(k * DT) if callable(speed) else speed, turn if speed else 0.0
        w = w if u else 0.0
        yaw += 0.5 * w * DT
        x, y = x + u * DT * cos(yaw), y + u * DT * sin(yaw)
        yaw += 0.5 * w * DT
        t, n = (k + 1) * DT, rng.standard_normal(7)
        fix = Fix(
            *(x + 0.02 * n[0], y + 0.02 * n[1], u * cos(yaw) + 0.03 * n[2], u * sin(yaw) + 0.03 * n[3]),
            t=t,
        )
        measurement = Measurement(
            *(t, fix, Quality.FIX, np.arctan2(w * 1.4, u) if u > 0 else 0.0, 0.0),
            gyro=w + radians(0.5) + radians(0.1) * n[4],
            wheel_speed=1.03 * u + 0.02 * n[5] if u else 0.0,
        )
        state, estimate = estimator.update(state, changed(t, measurement), DT)
        found.append((state, estimate, (x, y, yaw)))
    return found


def position_error(step):
    _, e, (x, y, _) = step
    return np.hypot(e.rear_x - x, e.rear_y - y)


# --- initial state


def test_keys_in_degrees_set_the_initial_uncertainty_in_radians():
    keys = {
        "position_sigma_m": 0.07,
        "gyro_bias_sigma_deg_s": 0.4,
        "steer_bias_sigma_deg": 1.5,
        "sideslip_sigma_deg": 3.0,
    }
    spec = EkfFull(**{f"initial_{name}": value for name, value in keys.items()}, initial_wheel_scale_sigma=0.03)
    state = spec.init(1.0, 2.0, 0.3, TRACTOR)
    sigma = np.sqrt(np.diag(state.horizon.core.covariance))
    assert sigma[[X, Y, K]].tolist() == pytest.approx([0.07, 0.07, 0.03])
    assert np.degrees(sigma[[B_G, B_S]]) == pytest.approx([0.4, 1.5])
    assert 0.1 < degrees(sigma[OMEGA]) < 10.0  # at rest
    assert sigma[PSI] > 1.5  # unknown
    levels = fetched(state.settings).filter.levels
    assert degrees(levels.sideslip_sigma) == pytest.approx(3.0)
    assert np.degrees([levels.gyro_sigma, levels.steer_sigma, levels.heading_sigma]) == pytest.approx([0.1, 1.0, 0.25])
    assert degrees(levels.sideslip_walk) == pytest.approx(0.1)
    assert degrees(state.horizon.core.mean[C]) == pytest.approx(0.7)
    walks = (0.003, 0.003, radians(0.012), 0.1, radians(3.0), radians(0.002), radians(0.1), 0.001)
    walks += (radians(0.005), 0.0005, radians(0.015) * TRACTOR.antenna_height_m)
    assert levels.walks == pytest.approx(walks)


def test_fix_noise_is_the_sum_of_white_correlated_and_tilt_errors():
    noises = EkfFull(terrain_compensation=True, imu_wander_sigma_deg=0.5)._fix_noises(2.0)
    lean = radians(0.5) * 2.0
    for quality, sigma, fraction, time in ((Quality.FIX, 0.02, 0.3, 30.0), (Quality.FLOAT, 0.3, 0.9, 60.0)):
        noise = noises[quality]
        assert noise.correlated**2 == pytest.approx(fraction * sigma**2 + lean**2)
        assert noise.white**2 == pytest.approx((1 - fraction) * sigma**2)
        assert noise.correlation_time == time


def test_change_of_fix_quality_resets_the_correlated_error():
    core = EkfFull().init(1.0, 2.0, 0.3, TRACTOR).horizon.core
    core.mean[[G_E, G_N]] = 0.8, -0.5
    covariance = core.covariance + 0.01
    mean, P = forget_correlated(core.mean, covariance)
    assert mean[[G_E, G_N]].tolist() == [0.0, 0.0]
    assert P[G_E].tolist() == np.eye(len(core.mean))[G_E].tolist()
    assert P[G_N].tolist() == np.eye(len(core.mean))[G_N].tolist()
    assert P[X, Y] == covariance[X, Y]
    assert core.mean[G_E] == 0.8


def test_estimated_cg_position_accounts_for_roll_and_pitch():
    roll, pitch, yaw = 0.15, -0.25, 0.6
    spec = EkfFull(terrain_compensation=True)
    fix = Fix(1.0, 2.0, 0.0, 0.0, t=DT)
    reading = Measurement(DT, fix, Quality.FIX, 0.0, 0.0, gyro=0.0, roll=roll, pitch=pitch, wheel_speed=0.0)
    _, e = spec.update(spec.init(1.0, 2.0, yaw, TRACTOR), reading, DT)
    c, s = np.cos, np.sin
    yawed = np.array([[c(yaw), -s(yaw), 0.0], [s(yaw), c(yaw), 0.0], [0.0, 0.0, 1.0]])
    pitched = np.array([[c(pitch), 0.0, s(pitch)], [0.0, 1.0, 0.0], [-s(pitch), 0.0, c(pitch)]])
    rolled = np.array([[1.0, 0.0, 0.0], [0.0, c(roll), -s(roll)], [0.0, s(roll), c(roll)]])
    cg = yawed @ pitched @ rolled @ [TRACTOR.cg_to_rear_axle, 0.0, TRACTOR.cg_height_m]
    assert (e.x - e.rear_x, e.y - e.rear_y) == pytest.approx(cg[:2], abs=2e-3)


# --- accuracy


def test_figure_eight_gives_accurate_position_and_heading(drive):
    numbers = [whole(follow(drive, FULL, seed)) for seed in range(4)]
    position, heading, course, yaw_rate, nees, nis, *_ = np.mean(numbers, axis=0)
    assert position < 2.5
    assert heading < 0.2
    assert course < 0.2
    assert yaw_rate < 0.12
    assert 1.0 < nees < 3.0
    assert 1.6 < nis < 2.4


def test_course_and_heading_are_both_accurate_on_a_side_slope():
    """The estimator uses the roll of the IMU. On 10 deg, the crab angle exceeds one degree."""
    slope = record("straight_line", SLOPE, 40.0)
    trace = follow(slope, {**FULL, **TILT}, 1)
    crab = degrees(np.mean((trace.course - trace.heading)[400:]))
    assert abs(np.mean(np.degrees(trace.course[400:]))) < 0.25
    assert abs(np.mean(np.degrees(trace.heading[400:]))) < 0.5
    assert rms(trace.position[400:]) < 0.03
    assert isfinite(crab)


# --- delayed fixes


def test_gnss_latency_increases_the_error_by_less_than_2_cm(drive):
    prompt, delayed = (whole(follow(drive, FULL, 1, day)).position for day in (lambda t: NOMINAL, late(0.2)))
    assert delayed - prompt < 2.0
    assert whole(follow(drive, BIAS, 1, late(0.2))).position > 15.0


def test_delayed_fix_updates_the_state_of_its_own_time():
    """For a varying delay in ticks, the filter state is bit-identical to the state with immediate fixes."""
    estimator, prompt = EkfFull(), simulated(EkfFull(), 20.0)
    fixes = [None, *(m for m in _measurements(20.0))]
    state = estimator.init(0.0, 0.0, 0.3, TRACTOR)
    delivered = 0
    for k in range(1, 401):
        lag = 0 if k < 100 else 4 if k < 200 else 9 if k < 300 else 2
        belongs = k - lag
        fix = fixes[belongs].fix if belongs > delivered else None
        delivered = max(delivered, belongs)
        state, estimate = estimator.update(state, fixes[k]._replace(fix=fix), DT)
        if fix is not None:
            assert len(state.horizon.waiting) == lag
            if k < 300:  # later some fixes arrive after newer ones and are ignored
                assert np.array_equal(state.horizon.core.mean, prompt[belongs - 1][0].horizon.core.mean)
    assert np.hypot(estimate.rear_x - prompt[-1][2][0], estimate.rear_y - prompt[-1][2][1]) < 0.05


def _measurements(duration):
    found = []
    simulated(EkfFull(), duration, changed=lambda t, m: found.append(m) or m)
    return found


def test_fix_older_than_the_previous_one_is_ignored():
    fixes, estimator = _measurements(5.0), EkfFull()
    state = estimator.init(0.0, 0.0, 0.3, TRACTOR)
    for m in fixes[:60]:
        state, _ = estimator.update(state, m, DT)
    blind, _ = estimator.update(state, fixes[60]._replace(fix=None), DT)
    old, _ = estimator.update(state, fixes[60]._replace(fix=fixes[20].fix), DT)
    assert np.array_equal(blind.horizon.core.mean, old.horizon.core.mean)


# --- losses of fixes


def test_position_error_stays_small_in_a_gnss_loss_on_an_arc(drive):
    short = [end(follow(drive, FULL, seed, loss(25.0, 5.0)), 30.0).position for seed in range(3)]
    long = [end(follow(drive, FULL, seed, loss(25.0, 20.0)), 45.0).position for seed in range(3)]
    assert rms(np.array(short)) < 5.0
    assert rms(np.array(long)) < 15.0
    assert end(follow(drive, BIAS, 0, loss(25.0, 20.0)), 45.0).position > 30.0


def test_time_since_last_fix_and_sigma_grow_without_fixes():
    def lost(t, m):
        return m._replace(fix=None, quality=Quality.NONE) if t > 10.0 else m

    steps = [e for _, e, _ in simulated(EkfFull(), 20.0, changed=lost)]
    assert steps[199].fix_age == pytest.approx(0.0, abs=1e-9)
    assert steps[-1].fix_age == pytest.approx(10.0, abs=1e-6)
    sigmas = np.array([e.position_sigma for e in steps])
    assert (np.diff(sigmas[205:]) > 0).all()
    assert sigmas[-1] > 2 * sigmas[199]


# --- alignment


@pytest.mark.parametrize("error_deg", [0.0, 30.0, 90.0, 180.0, -120.0])
def test_any_initial_heading_is_corrected_within_five_metres(drive, error_deg):
    short = drive._replace(truths=drive.truths[:300])
    metres, heading = alignment(follow(short, FULL, 7, yaw_error=radians(error_deg)))
    assert metres < 5.0
    assert heading < 1.0


def test_estimate_is_flagged_as_unaligned_until_the_heading_is_known():
    steps = simulated(EkfFull(), 6.0, speed=lambda t: 1.2 if t > 2 else 0.0, initial_yaw=2.5)
    aligned = [e.aligned for _, e, _ in steps]
    first = aligned.index(True)
    assert first > 40
    assert all(aligned[first:])
    assert degrees(np.sqrt(steps[first - 1][1].covariance[2, 2])) > 90
    assert degrees(np.sqrt(steps[first][1].covariance[2, 2])) < 2
    assert all(position_error(step) < 0.1 for step in steps)


def test_heading_is_found_in_reverse():
    steps = simulated(EkfFull(), 8.0, speed=-1.0, turn=0.05, initial_yaw=0.3 + 2.0)
    _, e, (_, _, yaw) = steps[-1]
    assert e.aligned
    assert degrees(abs(e.yaw - yaw)) < 1.5
    assert e.speed == pytest.approx(-1.0, abs=0.05)


def test_initial_yaw_error_key_offsets_the_initial_heading():
    state = EkfFull(initial_yaw_error_deg=90.0).init(0.0, 0.0, 0.3, TRACTOR)
    assert state.horizon.core.mean[2] == pytest.approx(0.3 + np.pi / 2)


# --- gates


def test_single_outlier_is_rejected(drive):
    short = drive._replace(truths=drive.truths[:700])
    clean, disturbed = (follow(short, FULL, 3, day) for day in (lambda t: NOMINAL, outlier(30.0, 2.0)))
    assert np.hypot(disturbed.east - clean.east, disturbed.north - clean.north).max() < 0.03
    clean, disturbed = (follow(short, PAPER, 3, day) for day in (lambda t: NOMINAL, outlier(30.0, 2.0)))
    assert np.hypot(disturbed.east - clean.east, disturbed.north - clean.north).max() > 0.1


def shifted(after, metres=2.0):
    return lambda t, m: m._replace(fix=m.fix._replace(x=m.fix.x + metres)) if t > after else m


def test_rejected_fixes_are_counted():
    once = simulated(EkfFull(), 12.0, changed=lambda t, m: shifted(0.0)(t, m) if abs(t - 10.0) < 0.01 else m)
    found = once[-1][0].horizon.core.rejections
    assert (found.positions, found.velocities, found.restarts) == (1, 0, 0)
    assert max(position_error(step) for step in once[180:]) < 0.05


def test_filter_restarts_and_accepts_a_permanent_position_shift():
    steps = simulated(EkfFull(), 20.0, changed=shifted(10.0))
    found = steps[-1][0].horizon.core.rejections
    assert found.restarts == 1
    assert found.positions == pytest.approx(40, abs=1)
    _, e, (x, _, _) = steps[-1]
    assert e.rear_x - x == pytest.approx(2.0, abs=0.05)
    assert steps[235][1].nis_mean > 20.0


def test_wrong_heading_estimate_restarts_the_alignment():
    """The vehicle is rotated by hand, which gyro and wheels do not measure."""
    found = _measurements(40.0)
    estimator = EkfFull()
    state, c, s = estimator.init(0.0, 0.0, 0.3, TRACTOR), cos(2.0), sin(2.0)
    turned = (Fix(c * f.x - s * f.y, s * f.x + c * f.y, c * f.vx - s * f.vy, s * f.vx + c * f.vy, f.t) for f in
              (m.fix for m in found))  # fmt: skip
    aligned = []
    for k, (m, fix) in enumerate(zip(found, turned, strict=True)):
        state, estimate = estimator.update(state, m._replace(fix=fix) if k > 200 else m, DT)
        aligned.append(estimate.aligned)
    assert not all(aligned[200:300])
    assert all(aligned[300:])
    assert estimate.nis_mean < 4.0


def test_fixes_of_an_oscillating_antenna_are_not_rejected():
    trace = follow(record("figure_eight", {"terrain": {"kind": "rough", "iso_class": "D"}}, 40.0), FULL, 1)
    assert trace.position[400:].max() < 0.2


# --- standstill and sensor faults


def test_speed_of_spinning_wheels_is_ignored():
    """From 10 s on, the tractor stops within two seconds, while the wheels continue turning at 1.2 m/s."""

    def stuck(t, m):
        return m._replace(wheel_speed=1.25) if t > 10.0 else m

    steps = simulated(EkfFull(), 25.0, speed=lambda t: max(0.0, min(1.2, 0.6 * (12.0 - t))), changed=stuck)
    assert max(position_error(step) for step in steps[100:]) < 0.15
    assert max(position_error(step) for step in steps[300:]) < 0.05
    assert abs(steps[-1][1].speed) < 0.05
    assert all(e.aligned for _, e, _ in steps[100:])


def frozen(t, m):
    """Simulate a receiver that repeats one position with zero velocity after 10 s."""
    return m._replace(fix=Fix(8.0, 6.0, 0.0, 0.0, t)) if t > 10.0 else m


def test_abrupt_stop_of_the_gnss_position_is_rejected():
    """A tractor cannot decelerate from 1.2 m/s within a tick."""
    steps = simulated(EkfFull(), 11.5, changed=frozen)
    assert all(e.speed == pytest.approx(1.2, abs=0.15) for _, e, _ in steps[200:])
    assert steps[-1][1].fix_age > 1.0


def test_fixes_that_contradict_the_velocity_stay_rejected_on_restart():
    """The position is constant, but the velocity correct. Every two seconds, the filter restarts and moves away."""

    def held(t, m):
        return m._replace(fix=m.fix._replace(x=8.0, y=6.0)) if t > 10.0 else m

    steps = simulated(EkfFull(), 22.0, changed=held)
    assert steps[-1][0].horizon.core.rejections.restarts >= 2
    assert steps[-1][1].fix_age > 10.0


def test_fixes_are_accepted_again_soon_after_a_restart():
    ages = [e.fix_age for _, e, _ in simulated(EkfFull(), 16.0, changed=shifted(10.0))]
    patience = EkfFull().gate_patience_s
    assert max(ages) == pytest.approx(2 * patience, abs=0.11)
    assert ages[-1] == pytest.approx(0.0, abs=1e-9)


def test_gyro_bias_is_estimated_at_standstill_without_drift():
    steps = simulated(EkfFull(), 20.0, speed=0.0)
    assert degrees(steps[-1][0].horizon.core.mean[B_G]) == pytest.approx(0.5, abs=0.05)
    assert abs(steps[-1][1].speed) < 0.01
    places = np.array([(e.rear_x, e.rear_y) for _, e, _ in steps[300:]])
    assert np.ptp(places, axis=0).max() < 0.12


@pytest.mark.parametrize("channel", ["gyro", "wheel_speed"])
def test_estimation_continues_without_gyro_or_wheel_speed(channel):
    steps = simulated(EkfFull(), 20.0, changed=lambda t, m: m._replace(**{channel: nan}) if t > 10.0 else m)
    assert max(position_error(step) for step in steps[100:]) < 0.1


def test_scenario_without_gyro_wheel_speed_or_imu_is_rejected():
    with pytest.raises(ScenarioError) as error:
        load_scenario("circle", {"estimator": {"kind": "ekf_full", "terrain_compensation": True}})
    for name in ("gyro", "wheel_speed", "imu"):
        assert f"needs sensors.{name}.enabled = true" in str(error.value)


# --- reported columns


@pytest.mark.parametrize("lost", [False, True])
def test_estimator_reports_one_value_per_column(lost):
    estimator = EkfFull()
    steps = simulated(estimator, 8.0, changed=lambda t, m: m._replace(fix=None) if lost else m)
    for state, _, _ in steps[::20]:
        assert len(estimator.report(state)) == len(estimator.columns)
    reported = dict(zip((column.name for column in estimator.columns), estimator.report(steps[-1][0]), strict=True))
    assert reported["aligned"] == float(not lost)
    assert reported["accepted_fix_age"] == pytest.approx(8.0 if lost else 0.0)
    assert estimator.report(estimator.init(0.0, 0.0, 0.0, TRACTOR))[0] != 0.0


def test_repeated_update_with_equal_arguments_gives_equal_results():
    estimator, steps = EkfFull(), simulated(EkfFull(), 5.0)
    extra = _measurements(5.05)[-1]
    state = steps[-1][0]
    before = state.horizon.core.mean.copy()
    first, again = (estimator.update(state, extra, DT)[1] for _ in range(2))
    assert first._replace(covariance=None) == again._replace(covariance=None)
    assert np.array_equal(before, state.horizon.core.mean)


# --- accuracy over many seeds


@pytest.mark.slow
def test_errors_for_twenty_seeds_are_below_their_limits():
    drives = [record("figure_eight", {"seed": k + 1}, 100.0) for k in range(4)]
    pairs = [(drives[k % 4], 100 + k) for k in range(20)]
    numbers = np.mean([whole(follow(d, FULL, seed)) for d, seed in pairs], axis=0)
    assert numbers[1] < 0.15
    assert 1.0 < numbers[4] < 3.0
    for seconds, limit in ((5.0, 5.0), (20.0, 15.0)):
        ends = [end(follow(d, FULL, seed, loss(25.0, seconds)), 25.0 + seconds).position for d, seed in pairs]
        assert rms(np.array(ends)) < limit


def test_compliance_and_wheel_slip_are_not_negative_on_long_fields():
    """A heavy tractor at 3 m/s turns often. Negative values grew until the estimate was 0.4 m ahead of the tractor."""
    sensors = {f"sensors.{name}.enabled": True for name in ("imu", "gyro", "wheel_speed")}
    keys = {"machine": "row_crop", "path.speed_m_s": 3.0, "guidance.kind": "lqr", "estimator.kind": "ekf_full"}
    sim = Simulation("clothoid_swaths", {**keys, **sensors, "duration_s": 240.0, "physics": "fast"})
    sim.reset()
    least = [np.inf, np.inf]
    while not sim.done:
        sim.advance()
        mean = sim.loop.stages.estimator.horizon.core.mean
        least = [min(least[0], mean[C]), min(least[1], mean[S])]
    assert min(least) >= 0.0
    assert sim.log().metrics["position_nees"] < 4.0
