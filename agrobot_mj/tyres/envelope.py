"""Contact of a wheel with curved ground: the wheel bridges gaps that are narrower than the wheel.

In the wheel plane the ground is a polyline with vertices where the plane crosses rows and columns of the height grid.
The wheel touches the point of the polyline nearest to its centre: the foot of the perpendicular on smooth ground, a
flank in a furrow, or an edge (the basic curve of a rigid wheel, [Pacejka2012] chapter 10). With the distance D of this
point from the wheel centre, the penetration is the radius minus D. The force has the direction in which D increases,
including sideways, so that the elastic energy is a function of position: a wheel dragged without friction over any
ground returns all work done on it.

Two nearest points, as on both flanks of a furrow, share the load if their penetrations differ by less than a width w:
the larger penetration p_1 becomes p_1 + w / 4 (1 - (p_1 - p_2) / w)^2. The width is the minimum of `BLEND` and the
depth of the ground between both points, relative to the second point; a vanishing second point therefore has zero
weight. On a plane the result is exactly the foot of the perpendicular.
"""

from math import ceil, floor, inf, sqrt
from typing import NamedTuple

from agrobot_mj.core.kernels import kernel
from agrobot_mj.core.vectors import Vector
from agrobot_mj.terrain.grid import Ground, height_and_gradient

REACH = 0.8
"""Half the length of the evaluated ground divided by the wheel radius [-]; contact is possible up to 53 deg ahead."""
BLEND = 0.005
"""Difference of penetrations below which two contact points share the load [m]. Assumed value: 1/3 of the
deflection."""
ALONG = 0.01
"""Component of the rolling direction perpendicular to grid lines [-], below which the wheel rolls along these lines."""
END, COLUMN, ROW = range(3)
"""Types of segment ends: end of the polyline, crossing of a column of nodes, and crossing of a row of nodes."""


class WheelPlane(NamedTuple):
    """Plane of a wheel, and the horizontal line below the wheel on which the ground is evaluated."""

    x: float  # East coordinate of the origin of the line, below the lowest point of the wheel [m]
    y: float  # North coordinate of the origin of the line [m]
    z: float  # Height of the wheel centre [m]
    ahead: tuple[float, float]  # Horizontal unit vector along the line
    level: float  # Cosine of the camber [-]
    camber: float  # Sine of the camber [-], positive with the left side up
    offset: float  # Distance of the line from the wheel centre [m], to the left


class Node(NamedTuple):
    """End of a straight ground segment in the wheel plane, relative to the wheel centre."""

    s: float  # Distance ahead of the wheel centre [m]
    w: float  # Distance above the wheel centre [m], in the wheel plane
    s_left: float  # Derivative of `s` with respect to a displacement of the wheel along its axle [-]
    w_left: float  # Derivative of `w` with respect to a displacement of the wheel along its axle [-]


class Spot(NamedTuple):
    """Point on the polyline of the ground, relative to the wheel centre."""

    distance: float  # Distance D from the wheel centre [m]
    s: float  # Distance ahead of the wheel centre [m]
    w: float  # Distance above the wheel centre [m], in the wheel plane
    left: float  # Derivative of the distance with respect to a displacement of the wheel along its axle [-]


class Places(NamedTuple):
    """Candidates for the contact point, updated while the polyline of the ground is followed."""

    best: Spot  # Point nearest to the wheel centre
    beside: Spot  # Local minimum of the distance next to `best`, the second nearest to the wheel centre
    ridge: Spot  # Farthest point between `best` and `beside`
    last: Spot  # Last local minimum found
    gap: Spot  # Local maximum of the distance that follows `last`


NOWHERE = Spot(inf, 0.0, -1.0, 0.0)


@kernel
def node_at(ground: Ground, plane: WheelPlane, s: float, kind: int) -> Node:
    """Return the segment end at the distance `s` ahead of the wheel centre [m]; `kind` is `END`, `COLUMN` or `ROW`."""
    h_x, h_y = plane.ahead
    height, dx, dy = height_and_gradient(ground, plane.x + s * h_x, plane.y + s * h_y)
    across = dy * h_x - dx * h_y
    # the plane of a tilted wheel meets the ground next to the line if the ground is not at its lowest point
    k = 1.0 / (plane.level + across * plane.camber)
    w = (height - across * plane.offset - plane.z) * k
    # when the wheel moves sideways, the node moves along its row or column
    moved, raised = 0.0, across
    if kind == COLUMN:
        moved, raised = h_y / h_x, dy / h_x
    elif kind == ROW:
        moved, raised = -h_x / h_y, -dx / h_y
    return Node(s, w, plane.level * moved, (plane.level * raised - plane.camber) * k)


@kernel
def spot_on(a: Node, b: Node, u: float) -> Spot:
    """Return the point at the fraction `u` of the ground segment from the end `a` to the end `b`."""
    s, w = a.s + u * (b.s - a.s), a.w + u * (b.w - a.w)
    D = sqrt(s * s + w * w)
    s_left, w_left = a.s_left + u * (b.s_left - a.s_left), a.w_left + u * (b.w_left - a.w_left)
    return Spot(D, s, w, (s * s_left + w * w_left) / D)


@kernel
def with_place(places: Places, found: Spot) -> Places:
    """Return the candidates updated with `found`, the next local minimum of the distance from the wheel centre."""
    best, beside, ridge, last, gap = places
    if found.distance < best.distance:
        return Places(found, last, gap, found, gap)
    if last.distance == best.distance and found.distance < beside.distance:
        return Places(best, found, gap, found, gap)
    return Places(best, beside, ridge, found, gap)


@kernel
def first_crossing(origin: float, ahead: float, first: float, spacing: float, reach: float) -> tuple[float, float]:
    """Return the position of the first grid-line crossing beyond `-reach` [m], and the spacing of the crossings [m]."""
    if abs(ahead) < ALONG:
        return inf, inf
    start = (origin - reach * ahead - first) / spacing
    index = floor(start) + 1.0 if ahead > 0.0 else ceil(start) - 1.0
    return (first + index * spacing - origin) / ahead, spacing / abs(ahead)


@kernel
def places_on(ground: Ground, plane: WheelPlane, reach: float) -> Places:
    """Return the candidates for the contact point within `reach` [m] ahead of and behind the wheel centre."""
    x, step_x = first_crossing(plane.x, plane.ahead[0], ground.x0, ground.spacing, reach)
    y, step_y = first_crossing(plane.y, plane.ahead[1], ground.y0, ground.spacing, reach)
    places = Places(NOWHERE, NOWHERE, NOWHERE, NOWHERE, NOWHERE)
    a, lowest, rising = node_at(ground, plane, -reach, END), NOWHERE, False
    while a.s < reach:
        s, kind = min(x, y, reach), END
        if s < reach:
            kind = COLUMN if x <= y else ROW
            x, y = (x + step_x, y) if x <= y else (x, y + step_y)
        b = node_at(ground, plane, s, kind)
        d_s, d_w = b.s - a.s, b.w - a.w
        length = d_s * d_s + d_w * d_w
        if length > 1e-18:
            u = min(max(-(a.s * d_s + a.w * d_w) / length, 0.0), 1.0)
            near = spot_on(a, b, u)
            if rising and u > 0.0:
                places = with_place(places, lowest)
                places = Places(places.best, places.beside, places.ridge, places.last, spot_on(a, b, 0.0))
                lowest = near
            elif near.distance < lowest.distance:
                lowest = near
            rising = u < 1.0
        a = b
    return with_place(places, lowest)


@kernel
def envelope(ground: Ground, radius: float, centre: Vector, axle: Vector) -> tuple[Vector, float]:
    """Return the unit vector of the ground force on a wheel, and the penetration of the wheel in this direction [m]."""
    level = sqrt(axle[0] * axle[0] + axle[1] * axle[1])
    if level < 1e-6:  # the wheel lies on its side
        return (0.0, 0.0, 1.0), height_and_gradient(ground, centre[0], centre[1])[0] - centre[2]
    left_x, left_y, offset = axle[0] / level, axle[1] / level, radius * axle[2]
    plane = WheelPlane(
        centre[0] + offset * left_x, centre[1] + offset * left_y, centre[2], (left_y, -left_x), level, axle[2], offset
    )
    best, beside, ridge, _, _ = places_on(ground, plane, REACH * radius)
    p, of_best, of_beside, of_ridge = radius - best.distance, 1.0, 0.0, 0.0
    apart, width = beside.distance - best.distance, min(ridge.distance - beside.distance, BLEND)
    if apart < width:
        x = 1.0 - apart / width
        p += 0.25 * width * x * x
        widening = x * (0.25 * x + 0.5 * apart / width) if width < BLEND else 0.0
        of_best, of_beside, of_ridge = 1.0 - 0.5 * x, 0.5 * x + widening, -widening
    along = of_best * best.s / best.distance
    up = of_best * best.w / best.distance
    aside = of_best * best.left
    if of_beside > 0.0:
        along += of_beside * beside.s / beside.distance + of_ridge * ridge.s / ridge.distance
        up += of_beside * beside.w / beside.distance + of_ridge * ridge.w / ridge.distance
        aside += of_beside * beside.left + of_ridge * ridge.left
    # gradient of the distance: ahead and up in the wheel plane, and along the axle
    g = (
        -along * left_y + up * axle[2] * left_x + aside * axle[0],
        along * left_x + up * axle[2] * left_y + aside * axle[1],
        -up * level + aside * axle[2],
    )
    size = sqrt(g[0] * g[0] + g[1] * g[1] + g[2] * g[2])
    # on a side slope the perpendicular is shorter than the distance in the wheel plane
    return (g[0] / size, g[1] / size, g[2] / size), p * size / (1.0 + aside * aside)
