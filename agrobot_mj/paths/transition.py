"""Clothoid transitions: bends whose change of curvature is limited by the maximum steering rate.

On a clothoid the curvature increases linearly with the distance s, kappa = sharpness * s. At the speed v the steering
angle delta = atan(L kappa) of a bicycle with wheelbase L then has the rate

  d(delta)/dt = L sharpness v / (1 + (L kappa)^2) <= L sharpness v.

With sharpness = steering rate / (L v), the steering rate reaches its limit only at the start of a bend. A bend consists
of an entry clothoid, an arc, and the mirrored exit clothoid. If the angle is too small to reach the radius of the arc,
the two clothoids meet. Without transitions (infinite sharpness) the bend is only the arc.
"""

from math import cos, inf, isinf, radians, sin, sqrt
from typing import Annotated, ClassVar, Literal, NamedTuple

from pydantic import Field

from agrobot_mj.core.spec import Positive, Spec
from agrobot_mj.paths.track import Piece

SteerRate = Annotated[float, Field(ge=1, le=90)]


class Transitions(Spec):
    """Configuration keys of the clothoids at both ends of a bend."""

    sized: ClassVar = {"wheelbase_m": {"length": 1}}

    transition: Literal["none", "clothoid"] = "none"
    """Transition at both ends of a bend: a step of the curvature (`none`) or a clothoid."""
    steer_rate_deg_s: SteerRate = 15.0
    """Maximum steering rate on clothoids [deg/s]. Assumed value (range 10-20), which is 60 % of the valve's maximum
    rate."""
    wheelbase_m: Positive = 1.40
    """Wheelbase for converting `steer_rate_deg_s` to a change of curvature [m]. Default: the tractor's wheelbase."""

    def sharpness(self, speed: float) -> float:
        """Return the change of curvature per metre [1/m2] of a clothoid at `speed` [m/s], or infinity without
        transitions."""
        if self.transition == "none":
            return inf
        return radians(self.steer_rate_deg_s) / (self.wheelbase_m * speed)

    def speed_for(self, sharpness: float) -> float:
        """Return the maximum speed [m/s] within the steering-rate limit on a clothoid of the given `sharpness`
        [1/m2]."""
        return inf if self.transition == "none" else radians(self.steer_rate_deg_s) / (self.wheelbase_m * sharpness)


class Bend(NamedTuple):
    """Symmetric bend of a path; coordinates are relative to the pose at the start of the bend."""

    angle: float  # Change of heading along the bend [rad]
    radius: float  # Radius of the arc, or radius at the joint of the clothoids of a bend without arc [m]
    sharpness: float  # Change of curvature per metre in the clothoids [1/m2], or infinity if there are no clothoids
    arc: float  # Length of the arc [m]

    @property
    def curvature(self) -> float:
        """Maximum absolute curvature of the bend [1/m]."""
        return 1 / self.radius

    @property
    def clothoid(self) -> float:
        """Length of each clothoid [m], or 0 without clothoids."""
        return 0.0 if isinf(self.sharpness) else self.curvature / self.sharpness

    @property
    def centre(self) -> tuple[float, float]:
        """Centre of the arc, as distances ahead of the bend's start and towards the inside of the bend [m]."""
        x, y, turned = spiral(self.clothoid, self.curvature)
        return x - sin(turned) * self.radius, y + cos(turned) * self.radius

    @property
    def tangent(self) -> float:
        """Distance from the start of the bend to the corner that the bend replaces [m], for angles below pi."""
        ahead, aside = self.centre
        return ahead + aside * sin(self.angle) / (1 + cos(self.angle))

    def pieces(self, left: float, speed: float = inf, direction: float = 1.0) -> list[Piece]:
        """Return the course segments of the bend.

        The wheels are turned left for a positive `left`, otherwise right. `direction` is 1 forward, -1 in reverse.
        """
        k = self.curvature if left > 0 else -self.curvature
        arc = Piece(self.arc, k, speed, direction=direction)
        if isinf(self.sharpness):
            return [arc]
        c = k / self.clothoid
        inward = Piece(self.clothoid, 0.0, speed, c, direction)
        return [inward, arc, Piece(self.clothoid, k, speed, -c, direction)]


def bend(angle: float, radius: float, sharpness: float) -> Bend:
    """Return a bend through `angle` [rad] with an arc of `radius` [m]. The radius is increased if the clothoids would
    exceed the angle."""
    if isinf(sharpness):
        return Bend(angle, radius, sharpness, radius * angle)
    radius = max(radius, 1 / sqrt(angle * sharpness))
    return Bend(angle, radius, sharpness, max(0.0, radius * angle - 1 / (radius * sharpness)))


def spiral(length: float, curvature: float) -> tuple[float, float, float]:
    """Return the end of a clothoid that starts with zero curvature: x ahead [m], y to the side [m], and heading
    [rad]."""
    # Series of the Fresnel integrals: cos and sin of turned * (s / length)^2, integrated term by term.
    turned = curvature * length / 2
    term, x, y = length, 0.0, 0.0
    for n in range(40):
        x += term / (4 * n + 1)
        term *= turned / (2 * n + 1)
        y += term / (4 * n + 3)
        term *= -turned / (2 * n + 2)
        if abs(term) < 1e-17 * length:
            break
    return x, y, turned
