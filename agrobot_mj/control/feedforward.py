"""Cascade of the paper with curvature feed-forward: delta = atan(L kappa) plus the output of the yaw controller.

With feed-forward, the yaw controller only rejects disturbances: tyre slip, side slope and steering errors. L is the
wheelbase, and kappa is the path curvature at the reference point `preview_s` later. The preview compensates the
response time of the steering. Source: the kinematic steady state in [Snider2009].
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
    """Kinematic law with a yaw controller and a feed-forward steering angle for the path curvature."""

    kind: Literal["feedforward"] = "feedforward"
    preview_s: Annotated[float, Field(ge=0, le=5)] = 0.3
    """Preview time of the curvature [s]. Assumed value (range 0.2-0.6): the sum of delay and lag of the steering."""

    ends_turns: ClassVar = True

    @property
    def interpreted(self) -> bool:
        """Whether ticks in compiled code must call the Python method `update`: true for subclasses."""
        return type(self) is not Feedforward

    def feedforward(self, situation: Situation) -> float:
        """Return the feed-forward steering angle [rad] for the curvature at the reference point `preview_s` later."""
        kappa, L = situation.route.at(situation.t + self.preview_s).curvature, situation.machine.wheelbase_m
        return atan(L * kappa)

    @property
    def columns(self) -> tuple[Column, ...]:
        """Log column of the feed-forward angle."""
        return (Column("steer_feedforward", "rad", "feed-forward steering angle for the path curvature"),)

    def report(self, state: CascadeState) -> Sequence[float]:
        """Return the values of the log columns for a state of the cascade."""
        return (state.feedforward,)
