"""Circle at constant speed after a ramp, starting at the origin with an eastward heading.

The centre is at (0, radius) for left turns and at (0, -radius) for right turns. The reference continues on the circle
after the last lap. With transition = "clothoid", a clothoid of increasing curvature leads to the origin, where the
first lap starts. Without the clothoid, the wheels must be turned at standstill.
"""

from functools import lru_cache
from math import pi
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from agrobot_mj.core.signals import Reference
from agrobot_mj.core.spec import Positive
from agrobot_mj.paths.arc import RAMP_S, Place, Pose, Ramp, advance, progress, reference, turns
from agrobot_mj.paths.base import ReferencePath
from agrobot_mj.paths.transition import Transitions

ORIGIN = Pose(0.0, 0.0, 0.0)  # Pose at the start of every lap


class Circle(Transitions, ReferencePath):
    """Path of complete laps around a circle."""

    radius_key: ClassVar = "radius_m"

    kind: Literal["circle"] = "circle"
    radius_m: Positive = 10.0
    """Radius of the circle [m]. Assumed value, equal to the arc radius of `figure_eight`."""
    ramp_s: Ramp = RAMP_S
    """Duration of the acceleration from rest [s], or 0 for no ramp. Assumed value, equal to the default of
    `figure_eight`."""
    turns: Annotated[int, Field(ge=1, le=1000)] = 2
    """Number of laps [-]."""
    direction: Literal["left", "right"] = "left"
    """Direction of travel around the circle; `left` is counter-clockwise seen from above."""

    @property
    def turn_s(self) -> float:
        """Duration of one lap at full speed [s]."""
        return 2 * pi * self.radius_m / self.speed_m_s

    @property
    def duration_s(self) -> float:
        """Time from the start to the end of the last lap [s]."""
        return self.turns_s[-1][1]

    @property
    def turns_s(self) -> tuple[tuple[float, float], ...]:
        """Start and end times of each lap [s]; the first lap starts after the clothoid."""
        return turns(self.turn_s, self.turns, self.ramp_s, _lead_in(self) / self.speed_m_s)

    @property
    def max_curvature(self) -> float:
        """Absolute curvature of the circle [1/m], which is the maximum of the path."""
        return 1 / self.radius_m

    @property
    def sharpest(self) -> Place:
        """First point of maximum curvature: the start of the circle, after the clothoid."""
        return Place(0.0, 0.0, _lead_in(self))

    def at(self, t: float) -> Reference:
        """Return the reference state at time `t` [s]; the circle continues after the last lap."""
        side, clothoid = (1.0 if self.direction == "left" else -1.0), _lead_in(self)
        curvature = side / self.radius_m
        moved, fraction = progress(t, self.ramp_s)
        if (ahead := clothoid - self.speed_m_s * moved) > 0:
            sharpness = curvature / clothoid
            pose = advance(ORIGIN, curvature, -ahead, sharpness)
            return reference(pose, curvature - sharpness * ahead, fraction * self.speed_m_s, sharpness)
        distance = self.speed_m_s * ((moved - clothoid / self.speed_m_s) % self.turn_s)
        return reference(advance(ORIGIN, curvature, distance), curvature, fraction * self.speed_m_s)


@lru_cache(maxsize=16)
def _lead_in(circle: Circle) -> float:
    """Return the length of the clothoid before the first lap [m], or 0 without a clothoid."""
    return 1 / (circle.radius_m * circle.sharpness(circle.speed_m_s))
