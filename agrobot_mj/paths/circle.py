"""A circle at constant speed after a ramp, from the origin, where it heads east.

The centre lies at (0, radius) when it turns left and at (0, -radius) when it turns right. The reference goes
on round beyond the last turn.
"""

from math import pi
from typing import Annotated, Literal

from pydantic import Field

from agrobot_mj.core.signals import Reference
from agrobot_mj.core.spec import Positive, Spec
from agrobot_mj.paths.arc import RAMP_S, Place, Pose, Ramp, Speed, advance, progress, reference, turns


class Circle(Spec):
    """Whole turns of a circle."""

    kind: Literal["circle"] = "circle"
    radius_m: Positive = 10.0
    """Radius [m]; estimate: as the arcs of the figure 8."""
    speed_m_s: Speed = 1.2
    """Speed of the reference [m/s]; estimate: 1-1.5 m/s fits the paper's 120 s a turn."""
    ramp_s: Ramp = RAMP_S
    """Time over which the speed rises from rest; 0: at once [s]. Estimate."""
    turns: Annotated[int, Field(ge=1, le=1000)] = 2
    """How often to go round [-]."""
    direction: Literal["left", "right"] = "left"
    """Which way it turns: left is counter-clockwise seen from above."""

    @property
    def turn_s(self) -> float:
        """Time of one turn at full speed [s]."""
        return 2 * pi * self.radius_m / self.speed_m_s

    @property
    def duration_s(self) -> float:
        """Time of all turns [s]."""
        return self.turns_s[-1][1]

    @property
    def turns_s(self) -> tuple[tuple[float, float], ...]:
        """(start, end) of each turn [s]."""
        return turns(self.turn_s, self.turns, self.ramp_s)

    @property
    def max_curvature(self) -> float:
        """Largest absolute curvature [1/m]."""
        return 1 / self.radius_m

    @property
    def sharpest(self) -> Place:
        """Where the curvature is largest: everywhere, so the start."""
        return Place(0.0, 0.0, 0.0)

    def at(self, t: float) -> Reference:
        """The reference at time `t` [s] since the start; any `t`, the circle goes on."""
        curvature = (1.0 if self.direction == "left" else -1.0) / self.radius_m
        moved, share = progress(t, self.ramp_s)
        distance = self.speed_m_s * (moved % self.turn_s)
        return reference(advance(Pose(0.0, 0.0, 0.0), curvature, distance), curvature, share * self.speed_m_s)
