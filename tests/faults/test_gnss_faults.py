"""RTK float, flicker and latency: statistics of the errors, and order of the solutions."""

from itertools import pairwise
from math import sqrt

import numpy as np
import pytest
from scripted import scripted

from agrobot_mj.core.signals import NOMINAL, TICK_S, Quality, Truth, worse
from agrobot_mj.faults import GnssFloat, GnssLatency
from agrobot_mj.faults.gnss import GnssDgps, GnssDrift, GnssFrozen, GnssJump
from agrobot_mj.sensors import Gnss

PERFECT = Gnss(sigma_m=0.0, float_sigma_m=0.0, velocity_sigma_m_s=0.0)


def truth(t):
    """Return the state of a motion east at 1 m/s from the origin, so that the position of a fix gives its time."""
    samples = np.zeros(1)
    pose = (t, t, 0.0, 0.5, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, t, 0.0)
    return Truth(*pose, (t, 0.0, 2.0), (1.0, 0.0, 0.0), samples, samples)


def days(fault, ticks, seed=1):
    return scripted((fault,), ticks, seed)


def delivered(gnss, conditions, seed=1):
    """Return fix and quality of each tick."""
    state, found = gnss.init(seed), []
    for k, day in enumerate(conditions):
        state, (fix, quality) = gnss.measure(state, truth(k * TICK_S), day, TICK_S)
        found.append((fix, quality))
    return found


# --- float --------------------------------------------------------------------------------------------------------


def test_float_offset_jumps_have_the_configured_rate_and_sigma():
    fault = GnssFloat(jump_sigma_m=0.2, jump_interval_s=2.0)
    offsets = np.array([day.gnss_offset for day in days(fault, 40_000)])
    at = np.flatnonzero((np.diff(offsets, axis=0) != 0).any(axis=1))
    n = 40_000 * TICK_S / 2.0
    assert len(at) == pytest.approx(n, abs=5 * sqrt(n) + n * TICK_S / 4)  # two jumps in one tick look like one
    solutions = offsets[np.append(at, len(offsets) - 1)]
    assert solutions.std(axis=0) == pytest.approx(0.2, rel=5 / sqrt(2 * n))
    assert np.abs(solutions.mean(axis=0)).max() < 5 * 0.2 / sqrt(n)
    assert abs(np.corrcoef(solutions.T)[0, 1]) < 5 / sqrt(n), "east and north are independent"
    steps = np.diff(solutions, axis=0)
    assert steps.std(axis=0) == pytest.approx(sqrt(2) * 0.2, rel=8 / sqrt(2 * n)), "between independent solutions"


def test_float_offset_is_constant_between_jumps():
    fault = GnssFloat(jump_interval_s=1e9)
    offsets = {day.gnss_offset for day in days(fault, 2000)}
    assert len(offsets) == 1
    assert offsets != {(0.0, 0.0)}


def test_float_fault_without_jumps_adds_no_error_to_the_float_solution():
    fault = GnssFloat(jump_sigma_m=0.0)
    assert {(day.gnss_quality, day.gnss_offset) for day in days(fault, 100)} == {(Quality.FLOAT, (0.0, 0.0))}


def test_float_offset_is_added_to_the_receiver_position():
    (day,) = days(GnssFloat(), 1)
    ((fix, quality),) = delivered(PERFECT, [day])
    assert quality == Quality.FLOAT
    assert (fix.x, fix.y) == pytest.approx(day.gnss_offset)


def test_fix_quality_changes_have_the_configured_mean_dwell_time():
    ticks = 100_000
    told = days(GnssFloat(flicker_s=1.0, jump_interval_s=1e9), ticks)
    quality = np.array([day.gnss_quality for day in told])
    assert set(quality) == {Quality.FLOAT, Quality.FIX}
    turns = np.flatnonzero(np.diff(quality))
    n = ticks * TICK_S
    assert len(turns) == pytest.approx(n, abs=5 * sqrt(n) + n * TICK_S), "exponential dwells of one second"
    assert (quality == Quality.FLOAT).mean() == pytest.approx(0.5, abs=5 * 0.5 * sqrt(2 / n))
    dwells = np.diff(turns) * TICK_S
    assert dwells.std() == pytest.approx(1.0, rel=0.1)
    for day in told:
        assert (day.gnss_quality == Quality.FIX) == (day.gnss_offset == (0.0, 0.0))


def test_float_offset_changes_after_each_change_of_fix_quality():
    told = days(GnssFloat(flicker_s=1.0, jump_interval_s=1e9), 2000)
    spells = sum(a.gnss_quality == Quality.FIX != b.gnss_quality for a, b in pairwise(told))
    assert len({day.gnss_offset for day in told} - {(0.0, 0.0)}) >= spells + 1 > 30


def test_float_errors_have_a_large_sigma_and_long_correlation_time():
    """Sigma, correlated fraction and correlation time are the values of the receiver for float solutions."""
    gnss, n, lags = Gnss(float_correlation_time_s=2.0), 100_000, np.array([0, 1, 20, 40])
    told = delivered(gnss, n * [NOMINAL._replace(gnss_quality=Quality.FLOAT)])
    for error in np.array([(fix.x - k * TICK_S, fix.y) for k, (fix, _) in enumerate(told)]).T:
        covariance = np.array([error[: n - lag] @ error[lag:] / (n - lag) for lag in lags]) / 0.3**2
        wanted = 0.9 * np.exp(-lags * TICK_S / 2.0) + 0.1 * (lags == 0)
        assert covariance == pytest.approx(wanted, abs=5 * sqrt(2 * 2.0 / (n * TICK_S)))


def test_errors_of_fix_and_float_solutions_evolve_independently():
    gnss = Gnss(correlated_fraction=1.0, float_correlated_fraction=1.0)
    floats = [NOMINAL._replace(gnss_quality=Quality.FLOAT)]
    first = [[delivered(gnss, [day], seed)[0][0].x for day in (NOMINAL, *floats)] for seed in range(1000)]
    assert abs(np.corrcoef(np.transpose(first))[0, 1]) < 5 / sqrt(1000)
    whole, mixed = delivered(gnss, 90 * floats), delivered(gnss, 30 * floats + 30 * [NOMINAL] + 30 * floats)
    assert mixed[60:] == whole[60:]


# --- offsets that are told ------------------------------------------------------------------------------------------


def test_position_offsets_of_jump_and_drift_faults_add_up():
    faults = GnssJump(east_m=0.3, north_m=-2.0), GnssDrift(east_m_s=0.1, north_m_s=0.4, start_s=1.0)
    told = scripted(faults, 41)
    assert told[0].gnss_offset == (0.3, -2.0)
    drifted = 41 * TICK_S - 1.0  # at the end of the tick
    assert told[40].gnss_offset == pytest.approx((0.3 + 0.1 * drifted, -2.0 + 0.4 * drifted))
    assert told[40].gnss_quality == NOMINAL.gnss_quality


# --- without corrections ------------------------------------------------------------------------------------------


def test_position_error_without_corrections_is_a_gauss_markov_process():
    """Variance of a Gauss-Markov process that starts at zero: sigma^2 (1 - exp(-2 t / T))."""
    ticks, T = 60, 2.0
    fault = GnssDgps(wander_time_s=T)
    offsets = np.array([[day.gnss_offset for day in days(fault, ticks, seed)] for seed in range(800)])
    t = TICK_S * (1 + np.arange(ticks))
    assert offsets.std(axis=(0, 2)) == pytest.approx(0.15 * np.sqrt(1 - np.exp(-2 * t / T)), rel=0.12)
    assert days(GnssDgps(), 1)[0].gnss_quality == Quality.DGPS


def test_receiver_with_frozen_position_may_report_current_velocity():
    """The position is frozen with quality 2, while the velocity is current."""
    day = days(GnssFrozen(quality="dgps", keep="live_velocity"), 1)[0]
    told = delivered(PERFECT, [NOMINAL] + 20 * [day])
    assert {(fix.x, quality) for fix, quality in told[1:]} == {(0.0, Quality.DGPS)}
    assert {fix.vx for fix, _ in told} == {1.0}


def test_fix_qualities_are_ordered_by_accuracy():
    order = (Quality.NONE, Quality.DGPS, Quality.FLOAT, Quality.FIX)
    assert all(worse(a, b) == worse(b, a) == a for k, a in enumerate(order) for b in order[k:])


# --- latency ------------------------------------------------------------------------------------------------------


def ages(own_s, extra, ticks=60):
    """Return the latency of the solution of each tick [ticks], or None; `extra(k)` adds ticks of latency."""
    gnss = PERFECT.model_copy(update={"latency_s": own_s})
    told = delivered(gnss, [NOMINAL._replace(gnss_latency_s=extra(k) * TICK_S) for k in range(ticks)])
    return [None if fix is None else round(k - fix.x / TICK_S) for k, (fix, _) in enumerate(told)]


@pytest.mark.parametrize("own", [0, 2])
def test_latency_increase_interrupts_the_solutions(own):
    found = ages(own * TICK_S, lambda k: 5 if 20 <= k < 40 else 0)
    assert found[:20] == own * [None] + (20 - own) * [own]
    assert found[20:25] == 5 * [None]
    assert found[25:40] == 15 * [own + 5]
    assert found[40:] == 20 * [own], "the newest there is, at once"


def test_delayed_solutions_arrive_in_order_and_only_once():
    rng = np.random.default_rng(3)
    extra = np.repeat(rng.integers(0, 12, 100), rng.integers(1, 9, 100))
    found = ages(0.1, lambda k: int(extra[k]), len(extra))
    taken = [k - age for k, age in enumerate(found) if age is not None]
    assert len(taken) > 100
    assert (np.diff(taken) > 0).all()
    assert all(age == extra[k] + 2 for k, age in enumerate(found) if age is not None)


def test_latency_fault_adds_to_the_latency_of_the_receiver():
    fault = GnssLatency(latency_s=0.25, start_s=1.0, end_s=2.0)
    assert [day.gnss_latency_s for day in days(fault, 60)] == 20 * [0.0] + 20 * [0.25] + 20 * [0.0]


def test_delayed_solutions_overtaken_by_newer_solutions_are_dropped():
    gnss = Gnss(latency_s=5.0)
    state, late = gnss.init(1), NOMINAL._replace(gnss_latency_s=5.0)
    for k in range(400):
        state, _ = gnss.measure(state, truth(k * TICK_S), late, TICK_S)
    assert len(state.delivery.pending) == 200
    state, _ = gnss.measure(state, truth(20.0), NOMINAL, TICK_S)
    assert len(state.delivery.pending) == 100
