"""The laws in cascade: which turns they ask for, and in reverse."""

from math import cos, radians, sin, sqrt

import numpy as np
import pytest
from drives import MACHINE, Bend

from agrobot_mj.control import Feedforward, Kinematic, Pd, Situation
from agrobot_mj.core.signals import TICK_S, Estimate
from agrobot_mj.paths.route import SampledRoute


def situation(path: Bend, heading: float = 0.0, speed: float = 1.2, t: float = 10.0) -> Situation:
    """On the path, turned by `heading` [rad] from its direction."""
    r = path.at(t)
    estimate = Estimate(r.x, r.y, r.yaw + heading, speed, 0.0, r.x, r.y, np.eye(3))
    return Situation(t, estimate, r, SampledRoute(path), MACHINE, 0.0)


@pytest.mark.parametrize("law", [Feedforward(), Kinematic(scheduled_above_m_s=1.5)])
@pytest.mark.parametrize("speed", [0.6, 1.2, 3.0])
def test_asks_for_turns_that_the_wheels_can_end(law: Kinematic | Feedforward, speed: float) -> None:
    """Wheels that take a second from lock to straight ahead lose the yaw rate g within g^2 L / (2 u rate).

    They answer after 0.3 s, so that no error is to be closed sooner.
    """
    for degrees in (0.5, 5.0, 20.0, 60.0):
        error = radians(degrees)
        _, asked = law.setpoints(situation(Bend(speed), error, speed))
        printed = speed * sin(error) / MACHINE.cg_to_rear_axle
        could_end = sqrt(2 * speed * sin(error) * MACHINE.steer_limit / MACHINE.wheelbase_m)
        assert asked == pytest.approx(-min(printed, sin(error) / 0.3, could_end), rel=1e-6)
        _, literal = Kinematic().setpoints(situation(Bend(speed), error, speed))
        assert literal == pytest.approx(-printed, rel=1e-6)


@pytest.mark.parametrize(("speed", "share"), [(0.6, 1.0), (1.5, 1.0), (6.0, 2.0)])
def test_tuned_laws_close_an_error_faster_at_speed(speed: float, share: float) -> None:
    """Far south of a path 0.3 rad from east the tanh is 1: the saturation itself, seen from the heading."""
    beside = situation(Bend(speed), speed=speed)
    aside = beside._replace(estimate=beside.estimate._replace(y=beside.estimate.y - 100.0))

    def sideways(law: Kinematic) -> float:
        return law.references(aside.estimate, aside.reference, MACHINE.cg_to_rear_axle)[1] * MACHINE.cg_to_rear_axle

    assert sideways(Kinematic()) == pytest.approx(0.6 * cos(0.3))
    assert sideways(Kinematic(scheduled_above_m_s=1.5)) == pytest.approx(0.6 * cos(0.3) * share)


def test_on_an_arc_it_asks_for_the_turn_of_the_arc_at_its_own_speed() -> None:
    """A CG on an arc heads inwards by asin(l_r kappa)."""
    inwards = np.arcsin(MACHINE.cg_to_rear_axle * 0.1)
    for speed in (0.6, 1.2):
        _, asked = Feedforward().setpoints(situation(Bend(1.2, 0.1), -inwards, speed))
        assert asked == pytest.approx(0.1 * speed, rel=0.01)


def test_a_tractor_ahead_of_its_reference_waits_for_it() -> None:
    """As after the search for its heading, when it is metres ahead of a slow reference."""
    on_path = situation(Bend(0.4), speed=0.4)
    x, y, yaw = on_path.estimate.x, on_path.estimate.y, on_path.reference.yaw
    ahead = on_path._replace(estimate=on_path.estimate._replace(x=x + 1.5 * cos(yaw), y=y + 1.5 * sin(yaw)))
    for law in (Feedforward(gain_per_m=1.4), Kinematic(gain_per_m=1.4, scheduled_above_m_s=1.5)):
        assert law.setpoints(ahead)[0] == pytest.approx(0.0, abs=0.01)
    assert Kinematic(gain_per_m=1.4).setpoints(ahead)[0] < -0.1


@pytest.mark.parametrize("law", [Kinematic(), Feedforward()])
def test_in_reverse_the_steering_turns_the_other_way(law: Kinematic | Feedforward) -> None:
    cascade = law.using(Pd(kp=0.4))

    def angle(speed: float) -> float:
        return cascade.update(cascade.init(), situation(Bend(1.2), 0.1, speed), TICK_S)[1].steer

    assert angle(1.0) < 0.0 < angle(-1.0)
