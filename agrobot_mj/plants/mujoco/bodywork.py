"""Visual body of a tractor, built from its dimensions: bonnet, seat or cab, fenders, mast and tyre lugs.

The visual geoms have no mass and no contact. The operator station has the same dimensions on all machines; the other
dimensions scale with wheelbase, track width and wheels. The bonnet does not touch the front wheels at any steering
angle, and parts between the rear wheels do not touch the rear wheels. The proportions follow photographs of each class.
"""

from collections.abc import Iterator
from math import cos, pi, radians, sin, sqrt
from typing import NamedTuple

import mujoco
import numpy as np

from agrobot_mj.core.signals import WHEELS
from agrobot_mj.machine.tractor import COMPACT, TractorParameters

Triple = tuple[float, float, float]
STRAIGHT = (1.0, 0.0, 0.0, 0.0)
ACROSS = (sqrt(0.5), sqrt(0.5), 0.0, 0.0)  # Quaternion that rotates the axis of a cylinder to the left
SEAT_BEFORE, SEATED, STANDING = 0.58, 0.20, 1.23
"""Distance of the seat behind the dashboard, and heights of seat and roll bar above the floor [m]."""
HEADROOM, LOW_ROOF, OVER_TYRE = 1.65, 1.35, 0.55
"""Default and minimum height of a cab roof above the cab floor [m], and minimum height of the roof above the rear tyres
[m]. A low antenna reduces the default height."""
LOOK = {"contype": 0, "conaffinity": 0, "group": 1, "mass": 0}  # Attributes of a visual geom without contact
HIDDEN = 3  # First group of geoms that are not drawn; geoms of lower groups are drawn
KINDS = {
    "box": mujoco.mjtGeom.mjGEOM_BOX,
    "cylinder": mujoco.mjtGeom.mjGEOM_CYLINDER,
    "capsule": mujoco.mjtGeom.mjGEOM_CAPSULE,
    "sphere": mujoco.mjtGeom.mjGEOM_SPHERE,
    "ellipsoid": mujoco.mjtGeom.mjGEOM_ELLIPSOID,
}
WHEEL_DISCS = (("rim", 0.6, 0.003, "rim"), ("disc", 0.48, 0.006, "iron"), ("hub", 0.2, 0.012, "rim"))
"""Discs of a drawn wheel: name, radius divided by tyre radius [-], protrusion from each tyre side [m], and material."""
HOOD = np.array((0.50, 0.24, 0.30)), np.array((1.06, 0.0, 0.74))
BAR, BAR_RADIUS = np.array((-0.16, -0.36, 1.85, -0.16, 0.36, 1.85)), 0.05
"""Contact shapes of the default tractor [m]: half sizes and centre of the bonnet; end points and radius of the roll
bar."""
LUGS, LEAN_DEG = 14.0, 25.0
"""Half the number of lugs on a tyre of 1 m radius [-], and angle between the lugs and the wheel axle [deg]."""
FENDER_DEG = (-62.0, -31.0, 0.0, 31.0, 62.0)
"""Angular positions of the fender segments about the wheel centre, measured forward from the vertical [deg]."""


class Panel(NamedTuple):
    """Primitive shape for drawing or contact, in the frame of the body that contains the shape."""

    name: str
    kind: str  # Type: box, cylinder, capsule, sphere or ellipsoid
    size: tuple[float, ...]  # Half sizes in the convention of MuJoCo [m]
    pos: Triple = (0.0, 0.0, 0.0)  # Centre of the shape [m]
    paint: str = "iron"
    quat: tuple[float, float, float, float] = STRAIGHT
    ends: tuple[float, ...] = ()  # Coordinates of both ends of a capsule [m], which replace its centre, shape (6,)


class Outline(NamedTuple):
    """Main dimensions of the visual body, in the chassis frame on level ground [m]."""

    gap: float  # Minimum distance between body and wheels [m]
    inside: float  # Half the free width between the rear wheels [m]
    narrow: float
    """Half the free width between the front wheels at any steering angle, minus the gap [m]; negative without free
    width."""
    between: tuple[float, float]
    """x coordinates of both ends of the space between the rear wheels and the steered front wheels [m]."""
    floor: float
    dash: float  # x coordinate of the bonnet's rear end [m]
    nose: float  # x coordinate of the bonnet's front end [m]
    half: float  # Half the width of the bonnet [m]
    low: float  # Height of the bonnet's lower edge [m]
    high: float  # Height of the bonnet's top [m]
    bar: Triple  # x coordinate, half width and height of the highest part: roll bar, roof, seat or deck [m]


def undress(spec: mujoco.MjSpec) -> None:
    """Remove the visual geoms of the chassis and the wheels from the model `spec`."""
    for name in bodies(COMPACT):
        for geom in list(spec.body(name).geoms):
            if not (geom.contype or geom.conaffinity):
                spec.delete(geom)


def dress(spec: mujoco.MjSpec, t: TractorParameters) -> None:
    """Add the visual geoms of the chassis and wheels, and set the sizes of the contact geoms and front-axle geoms."""
    for name, drawn in bodies(t).items():
        for part in drawn:
            draw(spec.body(name), part)
    for part in touching(t):
        geom = spec.geom(part.name)
        geom.size, geom.pos = [*part.size, 0.0, 0.0][:3], part.pos
        if part.ends:
            geom.fromto = part.ends
    _size_axle(spec, t, outline(t).low)


def touching(t: TractorParameters) -> tuple[Panel, Panel]:
    """Return the contact geoms of bonnet and roll bar, scaled to the tractor, for ground contact after a roll-over."""
    o, default = outline(t), outline(COMPACT)
    shares = np.array((t.wheelbase_m / COMPACT.wheelbase_m, o.half / default.half, o.high / default.high))
    size, pos, ends = shares * HOOD[0], shares * HOOD[1], np.tile(np.array(o.bar) / default.bar, 2) * BAR
    return (
        Panel("hood_contact", "box", tuple(size), tuple(pos)),
        Panel("rollbar_contact", "capsule", (BAR_RADIUS,), ends=tuple(ends)),
    )


def bodies(t: TractorParameters) -> dict[str, list[Panel]]:
    """Return the visual shapes of the chassis and of each wheel by body name, in the frame of the body."""
    sizes = {"f": (t.front_wheel_radius_m, t.front_wheel_width_m), "r": (t.rear_wheel_radius_m, t.rear_wheel_width_m)}
    return {"chassis": list(parts(t))} | {f"wheel_{name}": list(wheel(name, *sizes[name[0]])) for name in WHEELS}


def _size_axle(spec: mujoco.MjSpec, t: TractorParameters, top: float) -> None:
    """Set the sizes of the axle beam, axle post, steering arm and kingpins; `top` limits the post height [m]."""
    r, half = t.front_wheel_radius_m, t.track_m / 2
    k = r / COMPACT.front_wheel_radius_m
    beam, post, arm = (spec.geom(name) for name in ("axle_beam", "axle_post", "steering_arm"))
    beam.size = [0.05 * k, max(half - 0.1 * k, 0.05), 0.05 * k]
    post.size, post.pos = [0.06 * k, 0.07 * k, 0.45 * (top - r)], [0, 0, 0.45 * (top - r)]
    arm.size, arm.pos = k * arm.size, k * arm.pos
    for name, side in (("kingpin_fl", 1), ("kingpin_fr", -1)):
        pin = spec.geom(name)
        pin.size, pin.pos = k * pin.size, [0, -side * (t.front_wheel_width_m / 2 + 0.03 * k), 0.02 * k]


def wheel(name: str, radius: float, width: float) -> Iterator[Panel]:
    """Yield the visual shapes of a wheel: rim, disc, hub and lugs. The alternating lugs make its rotation visible."""
    for part, share, over, paint in WHEEL_DISCS:
        yield Panel(f"{part}_{name}", "cylinder", (share * radius, width / 2 + over), paint=paint, quat=ACROSS)
    count = 2 * round(LUGS * sqrt(radius))
    for k in range(count):
        a, side = 2 * pi * k / count, 1 if k % 2 else -1
        lean, at = radians(side * LEAN_DEG) / 2, (radius * sin(a), 0.24 * side * width, radius * cos(a))
        c, s = cos(a / 2), sin(a / 2)  # rotated about the axle, then about its own vertical axis
        turn = (c * cos(lean), s * sin(lean), s * cos(lean), c * sin(lean))
        half = (0.04 * radius, 0.27 * width, 0.045 * radius)
        yield Panel(f"lug_{name}_{k}", "box", half, at, "lug", turn)


def draw(body: mujoco.MjsBody, part: Panel, **other: int) -> None:
    """Add the shape `part` to a body as a geom with the attributes `LOOK`; `other` overrides these attributes."""
    place = {"fromto": part.ends} if part.ends else {"pos": part.pos, "quat": part.quat}
    size = [*part.size, 0.0, 0.0][:3]
    body.add_geom(name=part.name, type=KINDS[part.kind], size=size, material=part.paint, **place, **LOOK | other)


def outline(t: TractorParameters) -> Outline:
    """Return the main dimensions of the visual body of a tractor."""
    L, T, rf, rr, wf, wr = (
        *(t.wheelbase_m, t.track_m, t.front_wheel_radius_m, t.rear_wheel_radius_m),
        *(t.front_wheel_width_m, t.rear_wheel_width_m),
    )
    gap, reach, half = 0.02 * L, sqrt(rf**2 + (wf / 2) ** 2), min(0.24 * T, 0.45)
    low = max(rr + min(0.38 * rr, 0.16), _above_the_wheels(T / 2 - half - gap, rf, wf) + gap)
    high, floor, dash = low + 0.49 * sqrt(L / 1.4), rr + min(0.476 * rr, 0.20), 0.457 * L
    inside = max(T / 2 - wr / 2 - gap, 0.1 * T)
    seat = dash - SEAT_BEFORE
    bar = {
        "open": (seat - 0.19, min(0.19, inside), floor + SEATED + 0.35),
        "roll_bar": (seat - 0.22, inside - 0.03, floor + STANDING),
        "cab": (
            0.1 * L,
            min(T / 2, 0.8),
            max(min(floor + HEADROOM, t.antenna_height_m - 0.25), floor + LOW_ROOF, 2 * rr + OVER_TYRE),
        ),
        "robot": (0.5 * L, 0.35 * T, high),
    }[t.style]
    return Outline(
        *(gap, inside, T / 2 - reach - gap, (rr + gap, L - reach - gap), floor, dash, L + 0.62 * rf),
        *(half, low, high, bar),
    )


def _above_the_wheels(room: float, radius: float, width: float) -> float:
    """Return the maximum height of a steered front wheel [m] at lateral distances of `room` [m] or more from its
    centre."""
    if room >= sqrt(radius**2 + (width / 2) ** 2):
        return 0.0
    chord2 = max(room, width / 2) ** 2 - (width / 2) ** 2
    return radius + sqrt(radius**2 - chord2)


def parts(t: TractorParameters) -> Iterator[Panel]:
    """Yield all visual shapes of the chassis, in the chassis frame."""
    o = outline(t)
    if t.style == "robot":
        yield from _robot(o, t)
    else:
        yield from _front(o, t)
        yield from _fenders(o, t)
        yield from {"open": _seat, "roll_bar": _with_roll_bar, "cab": _cab}[t.style](o, t)
    yield from _drivetrain(o, t)
    yield from _antenna(o, t)


def _box(name: str, x: tuple[float, float], y: float, z: tuple[float, float], paint: str) -> Panel:
    half, at = ((x[1] - x[0]) / 2, y, (z[1] - z[0]) / 2), ((x[0] + x[1]) / 2, 0.0, (z[0] + z[1]) / 2)
    return Panel(name, "box", half, at, paint)


def _both(part: Panel) -> Iterator[Panel]:
    """Yield a part on the left side of the tractor, and its mirror image on the right side."""
    for name, side in (("left", 1), ("right", -1)):
        x, y, z = part.pos
        ends = tuple(side * e if k in (1, 4) else e for k, e in enumerate(part.ends))
        yield part._replace(name=f"{part.name}_{name}", pos=(x, side * y, z), ends=ends)


def _tube(name: str, start: Triple, end: Triple, radius: float) -> Panel:
    return Panel(name, "capsule", (radius,), ends=(*start, *end))


def _front(o: Outline, t: TractorParameters) -> Iterator[Panel]:
    tall, long, y = o.high - o.low, o.nose - o.dash, o.half
    edge = o.low + 0.82 * tall
    yield _box("hood", (o.dash, o.nose), y, (o.low, edge), "blue")
    yield _box("hood_top", (o.dash, o.nose - 0.08 * long), 0.84 * y, (edge - 0.01, o.high), "blue")
    yield _box("grille", (o.nose - 0.01, o.nose + 0.012), 0.75 * y, (o.low + 0.1 * tall, edge - 0.06 * tall), "iron")
    band, slots = (edge - 0.16 * tall, edge - 0.09 * tall), (o.low + 0.1 * tall, o.low + 0.5 * tall)
    yield _box("stripe", (o.dash + 0.06 * long, o.nose - 0.04 * long), y + 0.003, band, "rim")
    yield _box("vents", (o.dash + 0.45 * long, o.nose - 0.1 * long), y + 0.003, slots, "iron")
    lamp = min(0.045 * sqrt(t.wheelbase_m / 1.4), 0.3 * y)
    yield from _both(Panel("lamp", "sphere", (lamp,), (o.nose - 0.005, 0.72 * y, edge - 0.1 * tall), "rim"))
    if t.style == "roll_bar":
        x, z = o.dash + 0.55 * long, o.high + 0.3 * sqrt(t.wheelbase_m / 1.4)
        yield _tube("exhaust", (x, -0.8 * y, edge), (x, -0.8 * y, z), 0.028)


def _drivetrain(o: Outline, t: TractorParameters) -> Iterator[Panel]:
    rr, low = t.rear_wheel_radius_m, 0.8 * min(t.rear_wheel_radius_m, o.low)
    y, (behind, ahead) = min(0.15 * t.track_m, o.inside), o.between
    front = max(ahead, 0.3 * t.wheelbase_m)
    yield _box("gearbox", (-0.28 * rr, front), min(y, max(o.narrow, 0.2 * y)), (low, o.floor), "iron")
    yield Panel("rear_axle", "cylinder", (0.2 * rr, o.inside), (0.0, 0.0, rr), "iron", ACROSS)
    if o.narrow > 0.02:
        engine = min(0.13 * t.track_m, o.narrow)
        x, z = (min(o.dash, front - 0.05), o.nose - 0.05), (1.35 * t.front_wheel_radius_m, o.low + 0.02)
        yield _box("engine", x, engine, z, "iron")
    if t.style == "cab" and ahead - behind > 0.2:
        deep = (o.floor - 0.45 * rr) / 2
        half = ((ahead - behind) / 2, 0.07 * t.track_m, deep)
        at = ((behind + ahead) / 2, 0.42 * t.track_m - half[1], o.floor - deep)
        yield from _both(Panel("tank", "box", half, at, "iron"))


def _fenders(o: Outline, t: TractorParameters) -> Iterator[Panel]:
    rr, step = t.rear_wheel_radius_m, radians(FENDER_DEG[1] - FENDER_DEG[0])
    radius, outer = 1.07 * rr + o.gap, t.track_m / 2 + 0.4 * t.rear_wheel_width_m
    half = (1.06 * radius * sin(step / 2), (outer - o.inside) / 2, 0.012 * sqrt(t.wheelbase_m))
    for k, degrees in enumerate(FENDER_DEG):
        a, high = radians(degrees), rr + radius * cos(radians(degrees))
        at = (radius * sin(a), (outer + o.inside) / 2, high)
        yield from _both(Panel(f"fender_{k}", "box", half, at, "blue", (cos(a / 2), 0.0, sin(a / 2), 0.0)))
    yield _box("floor", (o.dash - 1.1 * SEAT_BEFORE, o.dash), o.inside, (o.floor - 0.02, o.floor), "iron")


def _seat(o: Outline, t: TractorParameters) -> Iterator[Panel]:
    x, wide, z, dash = o.dash - SEAT_BEFORE, min(0.19, o.inside - 0.02), o.floor + SEATED, o.dash
    yield Panel("seat", "box", (0.17, wide, 0.06), (x, 0.0, z), "iron")
    yield Panel("seat_back", "box", (0.05, wide, 0.17), (x - 0.19, 0.0, z + 0.18), "iron")
    yield _box("seat_box", (x - 0.22, x + 0.15), 0.8 * wide, (o.floor - 0.02, z), "blue")
    yield _tube("steering_column", (dash - 0.02, 0.0, o.floor + 0.13), (dash - 0.14, 0.0, o.floor + 0.5), 0.025)
    turned = (cos(radians(9)), 0.0, -sin(radians(9)), 0.0)
    yield Panel("steering_wheel", "cylinder", (0.16, 0.012), (dash - 0.15, 0.0, o.floor + 0.51), "iron", turned)


def _with_roll_bar(o: Outline, t: TractorParameters) -> Iterator[Panel]:
    yield from _seat(o, t)
    x, y, z = o.bar
    yield from _both(_tube("rollbar", (x, y, o.floor - 0.05), (x, y, z), 0.03))
    yield _tube("rollbar_top", (x, -y, z), (x, y, z), 0.03)


def _cab(o: Outline, t: TractorParameters) -> Iterator[Panel]:
    (_, wide, roof), back, front = o.bar, -0.2 * t.wheelbase_m, o.dash - 0.02
    sill = min(2.14 * t.rear_wheel_radius_m + 2 * o.gap, roof - 0.3)
    yield _box("cab_base", (back, front), o.inside, (o.floor - 0.06, sill), "blue")
    yield _box("doors", (o.between[0] * 0.6, front - 0.08), o.inside + 0.004, (o.floor + 0.1, sill), "glass")
    yield _box("glass", (back + 0.03, front - 0.03), wide - 0.02, (sill - 0.01, roof), "glass")
    for name, x in (("rear", back), ("middle", back + 0.42 * (front - back)), ("front", front - 0.02)):
        yield from _both(_tube(f"post_{name}", (x, wide - 0.02, sill), (x, wide - 0.02, roof), 0.028))
    yield _box("sills", (back, front), wide, (sill - 0.05, sill), "blue")
    yield _box("roof", (back - 0.06, front + 0.1), wide + 0.05, (roof, roof + 0.12), "rim")
    yield from _both(Panel("work_lamp", "box", (0.012, 0.09, 0.035), (front + 0.11, 0.6 * wide, roof + 0.06), "iron"))
    yield Panel("beacon", "cylinder", (0.05, 0.06), (back, -0.8 * wide, roof + 0.18), "signal")
    yield _tube("stack", (front + 0.06, -o.half, o.high - 0.1), (front + 0.06, -o.half, roof - 0.05), 0.045)


def _robot(o: Outline, t: TractorParameters) -> Iterator[Panel]:
    L, T, tail = t.wheelbase_m, t.track_m, -0.55 * t.rear_wheel_radius_m
    deck = 2 * max(t.front_wheel_radius_m, t.rear_wheel_radius_m) + 2 * o.gap + 0.03
    high = deck + 0.28 * sqrt(L / 1.4)
    yield _box("deck", (tail, o.nose), 0.42 * T, (deck, high - 0.06), "blue")
    yield _box("lid", (tail + 0.1 * L, o.nose - 0.15 * L), 0.34 * T, (high - 0.07, high), "rim")
    yield _box("stripe", (tail + 0.02, o.nose - 0.02), 0.42 * T + 0.003, (deck + 0.05, deck + 0.1), "signal")
    hull = (o.between[0], o.between[1])
    if hull[1] - hull[0] > 0.1:
        yield _box("hull", hull, 0.36 * T, (0.8 * t.front_wheel_radius_m, deck + 0.01), "iron")
    yield _box("bumper", (o.nose, o.nose + 0.1 * t.front_wheel_radius_m), 0.38 * T, (deck, deck + 0.12), "iron")
    yield from _both(Panel("lamp", "box", (0.01, 0.05, 0.025), (o.nose + 0.005, 0.33 * T, deck + 0.18), "rim"))
    yield Panel("scanner", "cylinder", (0.07, 0.06), (o.nose - 0.12, 0.0, high + 0.02), "iron")
    yield Panel("beacon", "cylinder", (0.05, 0.06), (tail + 0.1, -0.3 * T, high + 0.05), "signal")


def _antenna(o: Outline, t: TractorParameters) -> Iterator[Panel]:
    x, _, z = o.bar
    ahead, left, height = t.antenna
    if height > z:
        start = {"cab": (ahead, left, z), "robot": (ahead, left, z - 0.1)}.get(t.style, (x, 0.0, z))
        yield _tube("antenna_mast", start, (ahead, left, height - 0.04), 0.015)
    yield Panel("antenna_dome", "ellipsoid", (0.09, 0.09, 0.04), (ahead, left, height - 0.02), "signal")
