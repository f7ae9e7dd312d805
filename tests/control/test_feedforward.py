"""Setpoints of the cascaded guidance laws, and steering in reverse."""

from math import cos, radians, sin, sqrt

import numpy as np
import pytest
from drives import MACHINE, Bend

from agrobot_mj.control import Feedforward, Kinematic, Pd, Situation
from agrobot_mj.core.signals import TICK_S, Estimate
from agrobot_mj.paths.route import SampledRoute


def situation(path: Bend, heading: float = 0.0, speed: float = 1.2, t: float = 10.0) -> Situation:
    """Return the situation of a tractor on the path, rotated by `heading` [rad] from the path direction."""
    r = path.at(t)
    estimate = Estimate(r.x, r.y, r.yaw + heading, speed, 0.0, r.x, r.y, np.eye(3))
    return Situation(t, estimate, r, SampledRoute(path), MACHINE, 0.0)


@pytest.mark.parametrize("law", [Feedforward(), Kinematic(scheduled_above_m_s=1.5)])
@pytest.mark.parametrize("speed", [0.6, 1.2, 3.0])
def test_yaw_rate_setpoint_is_limited_by_steering_rate_and_response_time(
    law: Kinematic | Feedforward, speed: float
) -> None:
    """If the wheels need a second from lock to straight ahead, a turn at the yaw rate g ends within g^2 L / (2 u rate).

    The minimum time for correcting an error is 0.3 s, the response time of the steering.
    """
    for degrees in (0.5, 5.0, 20.0, 60.0):
        error = radians(degrees)
        _, yaw_rate = law.setpoints(situation(Bend(speed), error, speed))
        printed = speed * sin(error) / MACHINE.cg_to_rear_axle
        could_end = sqrt(2 * speed * sin(error) * MACHINE.steer_limit / MACHINE.wheelbase_m)
        assert yaw_rate == pytest.approx(-min(printed, sin(error) / 0.3, could_end), rel=1e-6)
        _, literal = Kinematic().setpoints(situation(Bend(speed), error, speed))
        assert literal == pytest.approx(-printed, rel=1e-6)


@pytest.mark.parametrize(("speed", "factor"), [(0.6, 1.0), (1.5, 1.0), (6.0, 2.0)])
def test_tuned_law_corrects_errors_faster_at_higher_speed(speed: float, factor: float) -> None:
    """The path is distant and 0.3 rad from east, so tanh is 1 and the correction velocity equals the saturation."""
    near = situation(Bend(speed), speed=speed)
    aside = near._replace(estimate=near.estimate._replace(y=near.estimate.y - 100.0))

    def sideways(law: Kinematic) -> float:
        return law.references(aside.estimate, aside.reference, MACHINE.cg_to_rear_axle)[1] * MACHINE.cg_to_rear_axle

    assert sideways(Kinematic()) == pytest.approx(0.6 * cos(0.3))
    assert sideways(Kinematic(scheduled_above_m_s=1.5)) == pytest.approx(0.6 * cos(0.3) * factor)


def test_yaw_rate_setpoint_on_arc_is_curvature_times_tractor_speed() -> None:
    """On an arc of the CG, the heading deviates from the tangent by asin(l_r kappa), inwards."""
    inwards = np.arcsin(MACHINE.cg_to_rear_axle * 0.1)
    for speed in (0.6, 1.2):
        _, yaw_rate = Feedforward().setpoints(situation(Bend(1.2, 0.1), -inwards, speed))
        assert yaw_rate == pytest.approx(0.1 * speed, rel=0.01)


def test_speed_setpoint_is_zero_when_tractor_is_ahead_of_reference() -> None:
    """This is the state after the search for the heading, with a slow reference some metres behind."""
    on_path = situation(Bend(0.4), speed=0.4)
    x, y, yaw = on_path.estimate.x, on_path.estimate.y, on_path.reference.yaw
    ahead = on_path._replace(estimate=on_path.estimate._replace(x=x + 1.5 * cos(yaw), y=y + 1.5 * sin(yaw)))
    for law in (Feedforward(gain_per_m=1.4), Kinematic(gain_per_m=1.4, scheduled_above_m_s=1.5)):
        assert law.setpoints(ahead)[0] == pytest.approx(0.0, abs=0.01)
    assert Kinematic(gain_per_m=1.4).setpoints(ahead)[0] < -0.1


@pytest.mark.parametrize("law", [Kinematic(), Feedforward()])
def test_steering_correction_has_the_opposite_sign_in_reverse(law: Kinematic | Feedforward) -> None:
    cascade = law.using(Pd(kp=0.4))

    def angle(speed: float) -> float:
        return cascade.update(cascade.init(), situation(Bend(1.2), 0.1, speed), TICK_S)[1].steer

    assert angle(1.0) < 0.0 < angle(-1.0)
