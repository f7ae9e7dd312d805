"""The paper's guidance: kinematic law, then a yaw controller.

The kinematic law turns the position error of the CG into speed and yaw-rate references; the yaw controller of
`[controller]` turns the yaw-rate error into a steering angle.

ENU position and velocity [m, m/s], heading psi [rad]; references u_ref [m/s] along the heading and gamma_ref
[rad/s], left positive. The law inverts the motion of a point l_r before a rear axle that rolls without slip.
Source: the paper, section III-A, after [Martins2008].

What it cannot do: follow a path in reverse (that point would have to trail the rear axle), wait for a tractor that is
ahead without turning its heading, and rest without an offset beside an arc or on a slope unless the yaw controller
integrates.
"""

from math import atan2, cos, hypot, sin, sqrt, tanh
from typing import ClassVar, Literal

from agrobot_mj.control.base import SLOWEST_M_S, GuidanceLaw, Situation, YawController
from agrobot_mj.control.cascade import Cascade
from agrobot_mj.control.following import TURNING_S
from agrobot_mj.control.pid import clip
from agrobot_mj.control.speed_network import SpeedNetwork
from agrobot_mj.core.geometry import from_heading, to_heading
from agrobot_mj.core.signals import Estimate, Reference
from agrobot_mj.core.spec import NonNegative, Positive
from agrobot_mj.machine.tractor import COMPACT

ANSWERED_S = 0.3
"""Time in which the steering answers [s]: a heading error is closed no sooner. Assumed value: delay and lag."""
REVERSING_M_S = 0.1
"""Estimated speed backwards beyond which the yaw rate answers the steering with the other sign [m/s]. Assumed value."""


class CascadeLaw(GuidanceLaw):
    """Kinematic law with a yaw controller inside; the paper prints no gains."""

    saturation_m_s: NonNegative = 0.6
    """Saturation k_s, largest velocity that closes an error, per axis [m/s]. Assumed value (0.3-1): half the speed."""
    gain_per_m: Positive = 0.4
    """Gain k_e, slope of the law relative to its saturation [1/m]. Assumed value: searched; 0.4 with `gains =
    "paper"`."""
    lateral_acceleration_m_s2: Positive = 2.0
    """Largest lateral acceleration that a command may ask for [m/s2]. Assumed value (1-3): the tractor tips at 6.8."""
    scheduled_above_m_s: Positive | None = None
    """Speed beyond which the yaw controller's gains fall as its inverse, since the yaw rate answers the steering by
    u / L [m/s]; 1.5 with tuned gains. When null they never do, and the law asks for any turn, as in the paper.
    Assumed value (1.2-2)."""
    speed_network: SpeedNetwork | None = None
    """A second network, on the speed; none when left out, which is what the paper tried."""
    tunable: ClassVar = {"gain_per_m": (0.1, 1.5), "saturation_m_s": (0.3, 1.5)}
    """Ranges in which the gains are sought."""
    holds_lane_change: ClassVar = True

    def references(self, estimate: Estimate, reference: Reference, cg_to_rear_axle: float) -> tuple[float, float]:
        """Speed [m/s] and yaw-rate [rad/s] references; `cg_to_rear_axle` is l_r > 0 [m]."""
        k_s, k_e, l_r, psi = self.saturation(reference), self.gain_per_m, cg_to_rear_axle, estimate.yaw
        vx = reference.vx + k_s * tanh(k_e * (reference.x - estimate.x))
        vy = reference.vy + k_s * tanh(k_e * (reference.y - estimate.y))
        if self.ends_turns:
            vx, vy = _onward(vx, vy, reference)
        u_ref = cos(psi) * vx + sin(psi) * vy
        gamma_ref = (-sin(psi) * vx + cos(psi) * vy) / l_r  # [agrobots: inversekinematicmodeltractor2]
        return u_ref, gamma_ref

    def saturation(self, reference: Reference) -> float:
        """Largest velocity that closes an error at the speed of the reference, k_s [m/s]."""
        return self.saturation_m_s

    @property
    def ends_turns(self) -> bool:
        """Whether the law asks only for turns that the steering can end, and waits instead of driving back."""
        return self.scheduled_above_m_s is not None

    def setpoints(self, situation: Situation) -> tuple[float, float]:
        """Speed [m/s] and yaw-rate [rad/s] references."""
        m = situation.machine
        speed, yaw_rate = self.references(situation.estimate, situation.reference, m.cg_to_rear_axle)
        return speed, _ended(yaw_rate, situation) if self.ends_turns else yaw_rate

    def gain_scale(self, situation: Situation) -> float:
        """Wheelbase over that of the paper's tractor, less beyond `scheduled_above_m_s`, negative in reverse [-]."""
        above, u = self.scheduled_above_m_s, situation.estimate.speed
        scale = situation.machine.wheelbase_m / COMPACT.wheelbase_m
        if above is not None:
            scale *= above / max(abs(u), above)
        return -scale if u < -REVERSING_M_S else scale

    def feedforward(self, situation: Situation) -> float:
        """Always 0: the paper's law learns the angle by feedback [rad]."""
        return 0.0

    def using(self, controller: YawController) -> Cascade:
        """The law in cascade with a yaw controller."""
        return Cascade(law=self, controller=controller)


class Kinematic(CascadeLaw):
    """The paper's guidance: position error to yaw rate, yaw rate to steering."""

    kind: Literal["kinematic"] = "kinematic"

    def saturation(self, reference: Reference) -> float:
        """More beyond `scheduled_above_m_s`, as the root of the speed [m/s].

        A step of curvature, which nothing foresees, leads farther away; as the speed itself it would swing over a line.
        """
        above = self.scheduled_above_m_s
        return self.saturation_m_s * (sqrt(max(hypot(reference.vx, reference.vy) / above, 1.0)) if above else 1.0)


def _onward(vx: float, vy: float, reference: Reference) -> tuple[float, float]:
    """The velocity without what leads back along the path [m/s]: a tractor ahead of its reference waits for it."""
    stands = not (reference.vx or reference.vy)
    course = reference.yaw if stands else atan2(reference.vy, reference.vx)
    onward, aside = to_heading(course, vx, vy)
    return from_heading(course, max(onward, 0.0), aside)


def _ended(yaw_rate: float, situation: Situation) -> float:
    """The yaw-rate reference [rad/s], or as much of it as the steering can follow and end in time.

    A tractor slower than its reference turns as much slower. A heading error e asks for a yaw rate u e / l_r beside
    that of the path, as if it closed in l_r / u; it is given `ANSWERED_S` at least. Wheels that turn back at the rate r
    end a turn in time if it is at most sqrt(2 u r e / L).
    """
    m, r, u = situation.machine, situation.reference, situation.estimate.speed
    turn = r.curvature * u
    beside = yaw_rate * min(abs(u) / max(hypot(r.vx, r.vy), SLOWEST_M_S), 1.0) - turn
    most = sqrt(2.0 * m.steer_limit / TURNING_S * m.cg_to_rear_axle / m.wheelbase_m * abs(beside))
    beside *= min(m.cg_to_rear_axle / max(abs(u) * ANSWERED_S, SLOWEST_M_S), 1.0)
    return turn + clip(beside, -most, most)
