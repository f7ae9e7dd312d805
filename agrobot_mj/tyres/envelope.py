"""Contact point of a wheel on curved ground: a wheel bridges gaps that are narrower than itself.

The tread in the wheel's middle plane is a circle. Its points within 50 degrees of straight down are compared with the
ground; the wheel stands on the one that lies deepest in it, and is pushed along that radius. On a smooth surface that
is the point of tangency, in a furrow it is a flank, on an edge the edge (the basic curve of a rigid wheel,
[Pacejka2012] chapter 10). Between points a parabola is fitted to three of them; where two places compete the
direction changes continuously from one to the other within `BLEND` of penetration. On a plane this gives exactly the
foot of the perpendicular.
"""

from math import inf, radians, sqrt

import numpy as np

from agrobot_mj.core.kernels import kernel
from agrobot_mj.core.vectors import Vector
from agrobot_mj.terrain.grid import Ground, height_and_gradient

MIDDLE = 11
"""Number of angles on either side of straight down; odd, so that straight down and the ends are evaluated."""
STEP = radians(5.0)
"""Step between angles [rad]."""
COS, SIN = (f(STEP * np.arange(-MIDDLE, MIDDLE + 1)) for f in (np.cos, np.sin))
"""Cosines and sines of the angles: every second one is evaluated, the others only next to the deepest."""
BLEND = 0.005
"""Difference of penetration within which two places share the load [m]. Estimate: a third of the static deflection."""
BASE = 0.5
"""Half the length over which the slope below the wheel is taken, over the radius [-]. Estimate."""
BASE_WIDTH = 0.25
"""Half the width over which the cross slope is taken, over the radius: about half the tyre's width [-]. Estimate."""


@kernel
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


@kernel
def depth_at(ground: Ground, centre: Vector, down: Vector, forward: Vector, c: float, s: float) -> float:
    """How far the point `c` down and `s` forward of the centre [m] lies below the ground, vertically [m]."""
    x, y = centre[0] + c * down[0] + s * forward[0], centre[1] + c * down[1] + s * forward[1]
    return height_and_gradient(ground, x, y)[0] - centre[2] - c * down[2] - s * forward[2]


@kernel
def peak_near(
    ground: Ground, radius: float, centre: Vector, down: Vector, forward: Vector, k: int, here: float
) -> tuple[float, float]:
    """Angle [rad] and depth [m] of the summit of a parabola through point `k`, `here` deep, and its neighbours."""
    before = depth_at(ground, centre, down, forward, radius * COS[k - 1], radius * SIN[k - 1])
    after = depth_at(ground, centre, down, forward, radius * COS[k + 1], radius * SIN[k + 1])
    bend, tilt = max(2 * here - before - after, 1e-9), (after - before) / 2
    aside = min(max(tilt / bend, -1.0), 1.0)
    return (k - MIDDLE + aside) * STEP, here + tilt * aside - bend * aside * aside / 2


@kernel
def deepest(ground: Ground, radius: float, centre: Vector, down: Vector, forward: Vector) -> tuple[float, float]:
    """Angle from the way down, forward positive [rad], and vertical depth [m] of the place the wheel stands on."""
    # the two deepest local maxima over every second angle; -inf beyond both ends, so that an end can be a maximum
    best = second = -inf
    best_k = second_k = MIDDLE
    before, here = -inf, depth_at(ground, centre, down, forward, radius * COS[1], radius * SIN[1])
    for k in range(1, COS.size - 1, 2):
        after = -inf
        if k + 2 < COS.size:
            after = depth_at(ground, centre, down, forward, radius * COS[k + 2], radius * SIN[k + 2])
        if here >= before and here > after:  # of equals on a plateau only the last
            if here > best:
                second, second_k, best, best_k = best, best_k, here, k
            elif here > second:
                second, second_k = here, k
        before, here = here, after
    phi, depth = peak_near(ground, radius, centre, down, forward, best_k, best)
    # so far behind that the few millimetres of a parabola cannot make up for it
    if best - second > 4 * BLEND:
        return phi, depth
    other_phi, other = peak_near(ground, radius, centre, down, forward, second_k, second)
    # two places that compete, as in a furrow: their angles are blended, so that the normal does not jump
    share = max(0.0, 1.0 - abs(depth - other) / BLEND)
    if other > depth:
        phi, other_phi, depth = other_phi, phi, other
    return (phi + share * other_phi) / (1.0 + share), depth
