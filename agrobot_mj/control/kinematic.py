"""Guidance of the paper: a kinematic law followed by a yaw controller.

The kinematic law maps the position error of the CG to speed and yaw-rate references. The yaw controller configured in
`[controller]` maps the yaw-rate error to a steering angle.

Inputs: ENU position and velocity [m, m/s] and heading psi [rad]. References: u_ref [m/s] along the heading and
gamma_ref [rad/s], positive to the left. The law inverts the motion of a point l_r ahead of a rear axle that rolls
without slip. Source: the paper, section III-A, after [Martins2008].

Limitations: The law cannot follow a path in reverse, where the point would have to trail the rear axle. A tractor ahead
of its reference turns while it waits. Without an integral term in the yaw controller, arcs and slopes cause an offset.
"""

from math import atan2, cos, isnan, nan, sin, sqrt, tanh
from typing import ClassVar, Literal

from agrobot_mj.control.base import SLOWEST_M_S, GuidanceLaw, Situation, YawController
from agrobot_mj.control.cascade import Cascade
from agrobot_mj.control.deviation import TURNING_S
from agrobot_mj.control.pid import clip
from agrobot_mj.control.speed_network import SpeedNetwork
from agrobot_mj.core.geometry import from_heading, to_heading
from agrobot_mj.core.kernels import shared
from agrobot_mj.core.signals import Estimate, Reference
from agrobot_mj.core.spec import NonNegative, Positive
from agrobot_mj.machine.tractor import COMPACT

MIN_CLOSING_S = 0.3
"""Minimum time constant for correcting a heading error [s]. Assumed value: the sum of delay and lag of the steering."""
COMPACT_WHEELBASE = COMPACT.wheelbase_m  # Wheelbase of the tractor for which the gains are given [m]
REVERSING_M_S = 0.1
"""Reverse speed [m/s] above which the sign of the yaw controller's gains is reversed. Assumed value."""


@shared
def approach(saturation: float, gain: float, estimate: Estimate, r: Reference) -> tuple[float, float]:
    """Return the desired velocity of the CG [m/s], east and north.

    `saturation` [m/s] is k_s and `gain` [1/m] is k_e.
    """
    return r.vx + saturation * tanh(gain * (r.x - estimate.x)), r.vy + saturation * tanh(gain * (r.y - estimate.y))


@shared
def inverse_kinematics(vx: float, vy: float, psi: float, l_r: float) -> tuple[float, float]:
    """Return the speed [m/s] and the yaw rate [rad/s] that give the CG the velocity (`vx`, `vy`) [m/s], east and north.

    `psi` [rad] is the heading, and `l_r` [m] the distance from the CG to the rear axle.
    """
    u_ref = cos(psi) * vx + sin(psi) * vy
    gamma_ref = (-sin(psi) * vx + cos(psi) * vy) / l_r  # [agrobots: inversekinematicmodeltractor2]
    return u_ref, gamma_ref


@shared
def scaled_saturation(saturation: float, above: float, r: Reference) -> float:
    """Return the saturation k_s [m/s]. Above the reference speed `above` [m/s], k_s is proportional to sqrt(speed).

    If `above` is NaN, k_s is constant.
    """
    speed = sqrt(r.vx * r.vx + r.vy * r.vy)
    return saturation if isnan(above) else saturation * sqrt(max(speed / above, 1.0))


@shared
def onward(vx: float, vy: float, r: Reference) -> tuple[float, float]:
    """Return a velocity [m/s] without its backward component along the path, so that the tractor waits instead of
    reversing."""
    at_rest = r.vx == 0.0 and r.vy == 0.0
    course = r.yaw if at_rest else atan2(r.vy, r.vx)
    ahead, aside = to_heading(course, vx, vy)
    return from_heading(course, max(ahead, 0.0), aside)


@shared
def feasible(yaw_rate: float, r: Reference, u: float, machine: tuple[float, float, float]) -> float:
    """Return a yaw-rate reference [rad/s] limited to turns that the steering can follow and end in time.

    A tractor slower than its reference turns at a proportionally lower rate. At the speed u, a heading error e adds a
    yaw rate u e / l_r. The error then decays with the time constant l_r / u, limited to at least `MIN_CLOSING_S`. If
    the wheels return at the rate r, a turn ends in time for yaw rates up to sqrt(2 u r e / L), with the wheelbase L.
    `machine` contains the maximum steering angle [rad], l_r and L [m].
    """
    steer_limit, l_r, wheelbase = machine
    turn = r.curvature * u
    speed = sqrt(r.vx * r.vx + r.vy * r.vy)
    correction = yaw_rate * min(abs(u) / max(speed, SLOWEST_M_S), 1.0) - turn
    most = sqrt(2.0 * steer_limit / TURNING_S * l_r / wheelbase * abs(correction))
    correction *= min(l_r / max(abs(u) * MIN_CLOSING_S, SLOWEST_M_S), 1.0)
    return turn + clip(correction, -most, most)


@shared
def gain_scale(wheelbase: float, above: float, u: float) -> float:
    """Return the factor on the yaw-rate error [-], negative in reverse; see `CascadeLaw.gain_scale`."""
    scale = wheelbase / COMPACT_WHEELBASE
    if not isnan(above):
        scale *= above / max(abs(u), above)
    return -scale if u < -REVERSING_M_S else scale


class CascadeLaw(GuidanceLaw):
    """Base class of the kinematic laws, which compute the yaw-rate reference of a yaw controller."""

    saturation_m_s: NonNegative = 0.6
    """Saturation k_s: maximum correction velocity per axis [m/s]. Assumed value (range 0.3-1): half the default
    speed."""
    gain_per_m: Positive = 0.4
    """Gain k_e: slope of the correction velocity divided by k_s [1/m]. Assumed value from tuning; 0.4 in the paper."""
    lateral_acceleration_m_s2: Positive = 2.0
    """Maximum lateral acceleration that a command may require [m/s2]. Assumed value (range 1-3); the compact tractor
    tips at 6.8 m/s2."""
    scheduled_above_m_s: Positive | None = None
    """Speed above which the gains of the yaw controller are inversely proportional to the speed [m/s], because the yaw
    rate per steering angle is u / L. Default: null (constant gains and unlimited turn rate, as in the paper), or 1.5
    with tuned gains. Assumed value (range 1.2-2)."""
    speed_network: SpeedNetwork | None = None
    """Network that corrects the speed command. Default: none, as in the paper's experiments."""
    tunable: ClassVar = {"gain_per_m": (0.1, 1.5), "saturation_m_s": (0.3, 1.5)}
    """Search ranges for tuning the gains."""
    holds_lane_change: ClassVar = True

    def references(self, estimate: Estimate, reference: Reference, cg_to_rear_axle: float) -> tuple[float, float]:
        """Return the speed [m/s] and yaw-rate [rad/s] references; `cg_to_rear_axle` is the distance l_r [m]."""
        vx, vy = approach(self.saturation(reference), self.gain_per_m, estimate, reference)
        if self.ends_turns:
            vx, vy = onward(vx, vy, reference)
        return inverse_kinematics(vx, vy, estimate.yaw, cg_to_rear_axle)

    def saturation(self, reference: Reference) -> float:
        """Return the maximum correction velocity k_s [m/s] for the speed of the reference."""
        return self.saturation_m_s

    @property
    def ends_turns(self) -> bool:
        """Whether the law limits the yaw rate to the turning ability of the tractor, and waits for the reference
        instead of reversing."""
        return self.scheduled_above_m_s is not None

    def setpoints(self, situation: Situation) -> tuple[float, float]:
        """Return the speed [m/s] and yaw-rate [rad/s] references of the current tick."""
        m = situation.machine
        speed, yaw_rate = self.references(situation.estimate, situation.reference, m.cg_to_rear_axle)
        if self.ends_turns:
            size = m.steer_limit, m.cg_to_rear_axle, m.wheelbase_m
            yaw_rate = feasible(yaw_rate, situation.reference, situation.estimate.speed, size)
        return speed, yaw_rate

    def gain_scale(self, situation: Situation) -> float:
        """Return the factor on the yaw-rate error [-], negative in reverse.

        The factor is proportional to the wheelbase and, above `scheduled_above_m_s`, to the inverse of the speed.
        """
        above, u = self.scheduled_above_m_s, situation.estimate.speed
        return gain_scale(situation.machine.wheelbase_m, nan if above is None else above, u)

    def feedforward(self, situation: Situation) -> float:
        """Return the feed-forward steering angle [rad], which is 0 for the paper's law."""
        return 0.0

    def using(self, controller: YawController) -> Cascade:
        """Return the cascade of this law and a yaw controller."""
        return Cascade(law=self, controller=controller)


class Kinematic(CascadeLaw):
    """Guidance law of the paper, which maps the position error to speed and yaw-rate references."""

    kind: Literal["kinematic"] = "kinematic"

    @property
    def interpreted(self) -> bool:
        """Whether ticks in compiled code must call the Python method `update`: true for subclasses."""
        return type(self) is not Kinematic

    def saturation(self, reference: Reference) -> float:
        """Return the saturation k_s [m/s], proportional to sqrt(reference speed) above `scheduled_above_m_s`.

        Curvature steps cause larger errors at higher speed, but a linear increase of k_s would cause overshoot.
        """
        above = self.scheduled_above_m_s
        return scaled_saturation(self.saturation_m_s, nan if above is None else above, reference)
