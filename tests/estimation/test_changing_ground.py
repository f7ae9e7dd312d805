"""`ekf_full` where the ground changes: slopes, ruts, pulls; and its parts that know of them."""

from math import atan2, cos, degrees, radians, sin, sqrt

import numpy as np
import pytest

from agrobot_mj.core.geometry import wrap
from agrobot_mj.estimation.levelling import SmoothedTilt
from agrobot_mj.estimation.wheel_slip import WheelSlip
from agrobot_mj.studies.validation.filters import FULL, SLOPE, TILT, follow, loss, record, rms

LQR = {"guidance": {"kind": "lqr"}, "estimator": FULL}
DT = 0.05


@pytest.mark.parametrize("body", [False, True])
def test_a_turn_on_an_inclined_plane_is_a_whole_turn(body):
    """A body turns about the normal of a plane of 20 deg; its heading is the plan of its forward axis."""
    slope, rate, ticks = radians(20.0), 2 * np.pi / 20.0, 400
    frame = np.array([[1, 0, 0], [0, cos(slope), -sin(slope)], [0, sin(slope), cos(slope)]])
    tilt, heading = None, 0.0
    for k in range(ticks + 1):
        angle = rate * k * DT
        forward = frame @ [cos(angle), sin(angle), 0.0]
        left = frame @ [-sin(angle), cos(angle), 0.0]
        roll, pitch = atan2(left[2], frame[2, 2]), -np.arcsin(forward[2])
        tilt = tilt.after(roll, pitch, DT) if tilt else SmoothedTilt(roll, pitch)
        if k:
            heading += tilt.heading_rate(rate if body else rate * cos(slope), body) * DT
    assert degrees(heading) == pytest.approx(360.0, abs=1.5)  # the low pass lags, by 0.5 s of the rates at the start
    assert degrees(2 * np.pi * (1 - cos(slope))) > 20.0  # what a gyro about the vertical misses


def test_steady_slip_is_none_of_its_business_and_a_pull_is_remembered():
    rng, slip = np.random.default_rng(3), WheelSlip()
    variance = 0.03**2
    for _ in range(1200):
        slip = slip.after(sqrt(variance) * rng.standard_normal(), variance, 0.0025**2, DT)
    assert slip.walk < 0.001
    for _ in range(10):
        slip = slip.after(0.1, variance, 0.0025**2, DT)
    assert slip.change**0.5 > 0.01
    calm = slip
    for _ in range(200):
        calm = calm.after(0.0, variance, 0.0025**2, DT)
    assert calm.change == 0.0
    lost = calm.unseen()
    assert 0.001 < lost.walk < 0.05
    assert lost.unseen() == lost


@pytest.fixture(scope="module")
def slope():
    return record("figure_eight", {**LQR, **SLOPE, "estimator": {**FULL, **TILT}, "seed": 71}, 60.0)


def test_on_a_slope_the_heading_is_as_good_as_it_says(slope):
    traces = [follow(slope, {**FULL, **TILT}, seed) for seed in (721, 722, 723)]
    squares = [np.mean(trace.heading_nees[400:]) for trace in traces]
    assert 0.3 < np.mean(squares) < 2.5


def test_a_loss_on_a_slope_costs_what_it_says(slope):
    ends = [follow(slope, {**FULL, **TILT}, seed, loss(42.0, 11.0)) for seed in (721, 722, 723)]
    last = round(53.0 / DT) - 2
    assert np.mean([trace.nees[last] for trace in ends]) < 6.0
    assert rms(np.array([trace.position[last] for trace in ends])) < 0.20


def test_in_ruts_most_of_the_sideslip_is_told_from_heading():
    """A filter that knows firm ground alone takes all of it, 1.7 deg, for heading."""
    ruts = record("figure_eight", {**LQR, "plant.tyre.kind": "ruts", "seed": 72}, 60.0)
    sideslip = [wrap(atan2(t.rear_velocity[1], t.rear_velocity[0]) - t.yaw) for t in ruts.truths[800:]]
    assert degrees(rms(np.array(sideslip))) > 1.0
    assert rms(follow(ruts, FULL, 724).heading[800:]) < 0.5 * rms(np.array(sideslip))
