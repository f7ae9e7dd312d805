"""The paper's cascade with curvature feed-forward: delta = atan(L kappa) beside the yaw controller's angle.

The yaw controller then has only the difference to correct: slip, side slope, steering errors. kappa is the path's
curvature where the reference will be when the steering has answered. Source: [Snider2009], kinematic steady state.
"""

from collections.abc import Sequence
from math import atan
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from agrobot_mj.control.base import Situation
from agrobot_mj.control.cascade import CascadeState
from agrobot_mj.control.kinematic import CascadeLaw
from agrobot_mj.core.signals import Column


class Feedforward(CascadeLaw):
    """Kinematic law, yaw controller, and the angle that the curvature of the path asks for."""

    kind: Literal["feedforward"] = "feedforward"
    preview_s: Annotated[float, Field(ge=0, le=5)] = 0.3
    """Time by which the curvature is taken ahead [s]. Assumed value (0.2-0.6): delay and lag of the steering."""

    ends_turns: ClassVar = True

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
