"""Where a wheel touches curved ground: a wheel bridges what is narrower than itself.

The tread in the wheel's middle plane is a circle. Its points within 50 degrees of the way down are compared with the
ground; the wheel stands on the one that lies deepest in it, and is pushed along that radius. On a smooth surface that
is the point of tangency, in a furrow it is a flank, on an edge the edge (the basic curve of a rigid wheel,
[Pacejka2012] chapter 10). Between points a parabola is laid through three of them; where two places compete the
direction goes over from one to the other within `BLEND` of penetration. On a plane all this yields the foot of the
perpendicular exactly.
"""

from math import cos, inf, radians, sin, sqrt

from agrobot_mj.compiled import jit
from agrobot_mj.terrain.grid import Ground, height_and_gradient

POINTS = 10
"""On either side of the middle."""
STEP = radians(5.0)
"""Between points [rad]."""
BLEND = 0.005
"""Penetration within which two places share the load [m]. Estimate: a third of the static deflection."""
BASE = 0.5
"""Half the length over which the slope below the wheel is taken, over the radius [-]. Estimate."""
BASE_WIDTH = 0.25
"""Likewise across: about half the width of the tyre [-]. Estimate."""

Vector = tuple[float, float, float]


@jit
def slope_below(ground: Ground, radius: float, centre: Vector, axle: Vector) -> tuple[float, float]:
    """Slopes dh/dx, dh/dy of the ground over the footprint of a wheel [-]."""
    level = sqrt(axle[0] ** 2 + axle[1] ** 2)
    if level < 1e-6:
        return 0.0, 0.0
    left_x, left_y = axle[0] / level, axle[1] / level
    a, b = BASE * radius, BASE_WIDTH * radius
    ahead = height_and_gradient(ground, centre[0] + a * left_y, centre[1] - a * left_x)[0]
    behind = height_and_gradient(ground, centre[0] - a * left_y, centre[1] + a * left_x)[0]
    left = height_and_gradient(ground, centre[0] + b * left_x, centre[1] + b * left_y)[0]
    right = height_and_gradient(ground, centre[0] - b * left_x, centre[1] - b * left_y)[0]
    along, across = (ahead - behind) / (2 * a), (left - right) / (2 * b)
    return along * left_y + across * left_x, across * left_y - along * left_x


@jit
def depth_at(ground: Ground, radius: float, centre: Vector, down: Vector, forward: Vector, phi: float) -> float:
    """How far the point of the tread at `phi` [rad] from the way down lies below the ground, vertically [m]."""
    c, s = radius * cos(phi), radius * sin(phi)
    x, y = centre[0] + c * down[0] + s * forward[0], centre[1] + c * down[1] + s * forward[1]
    return height_and_gradient(ground, x, y)[0] - centre[2] - c * down[2] - s * forward[2]


@jit
def deepest(ground: Ground, radius: float, centre: Vector, down: Vector, forward: Vector) -> tuple[float, float]:
    """Angle from the way down, forward positive [rad], and vertical depth [m] of the place the wheel stands on."""
    best = second = -inf
    best_phi = second_phi = 0.0
    before = depth_at(ground, radius, centre, down, forward, -(POINTS + 1) * STEP)
    here = depth_at(ground, radius, centre, down, forward, -POINTS * STEP)
    for k in range(-POINTS, POINTS + 1):
        after = depth_at(ground, radius, centre, down, forward, (k + 1) * STEP)
        if here >= before and here >= after:
            bend, tilt = max(2 * here - before - after, 1e-9), (after - before) / 2
            depth, phi = here + tilt * tilt / (2 * bend), (k + tilt / bend) * STEP
            if depth > best:
                second, second_phi, best, best_phi = best, best_phi, depth, phi
            elif depth > second:
                second, second_phi = depth, phi
        before, here = here, after
    if best == -inf:
        return 0.0, depth_at(ground, radius, centre, down, forward, 0.0)
    share = max(0.0, 1.0 - (best - second) / BLEND)
    if share > 0.0:
        best_phi = (best_phi + share * second_phi) / (1.0 + share)
    return best_phi, best
