"""The paper's cascade with curvature feed-forward: delta = atan(L kappa) beside the yaw controller's angle.

The yaw controller then has only the difference to correct: slip, side slope, steering errors. kappa is the path's
curvature where the reference will be when the steering has answered. Source: [Snider2009], kinematic steady state.
"""

from collections.abc import Sequence
from math import atan, hypot, sqrt
from typing import Annotated, Literal

from pydantic import Field

from agrobot_mj.control.base import SLOWEST_M_S, Situation
from agrobot_mj.control.cascade import CascadeState
from agrobot_mj.control.following import TURNING_S
from agrobot_mj.control.kinematic import CascadeLaw
from agrobot_mj.control.pid import clip
from agrobot_mj.core.signals import Column


class Feedforward(CascadeLaw):
    """Kinematic law, yaw controller, and the angle that the curvature of the path asks for."""

    kind: Literal["feedforward"] = "feedforward"
    preview_s: Annotated[float, Field(ge=0, le=5)] = 0.3
    """Time by which the curvature is taken ahead [s]. Estimate (0.2-0.6): delay and lag of the steering."""

    def setpoints(self, situation: Situation) -> tuple[float, float]:
        """Speed [m/s] and yaw-rate [rad/s] references, of turns that the steering can end.

        A tractor slower than its reference turns as much slower. A heading error e asks for a yaw rate u e / l_r
        beside that of the path; wheels that turn back at the rate r end it in time if it is at most sqrt(2 u r e / L),
        the root of (2 r l_r / L) times what is asked for.
        """
        speed, yaw_rate = super().setpoints(situation)
        m, r, u = situation.machine, situation.reference, situation.estimate.speed
        turn = r.curvature * u
        beside = yaw_rate * min(abs(u) / max(hypot(r.vx, r.vy), SLOWEST_M_S), 1.0) - turn
        most = sqrt(2.0 * m.steer_limit / TURNING_S * m.cg_to_rear_axle / m.wheelbase_m * abs(beside))
        return speed, turn + clip(beside, -most, most)

    def feedforward(self, situation: Situation) -> float:
        """atan(L kappa) [rad]."""
        kappa, L = situation.route.at(situation.t + self.preview_s).curvature, situation.machine.wheelbase_m
        return atan(L * kappa)

    @property
    def columns(self) -> tuple[Column, ...]:
        """The feed-forward angle."""
        return (Column("steer_feedforward", "rad", "steering angle that the curvature of the path asks for"),)

    def report(self, state: CascadeState) -> Sequence[float]:
        """Values of `columns`."""
        return (state.feedforward,)
