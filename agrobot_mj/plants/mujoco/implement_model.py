"""The implement's part of the MuJoCo model: a body at the hitch, its hinges, its wheels and what is drawn of it."""

import mujoco

from agrobot_mj.machine.implements.base import Axle, HitchedBody, Shape
from agrobot_mj.machine.tractor import TractorParameters
from agrobot_mj.plants.mujoco.bodywork import ACROSS, Panel, draw
from agrobot_mj.plants.mujoco.bodywork import wheel as drawn_wheel
from agrobot_mj.plants.mujoco.mechanism import LIMITED, in_unit_of
from agrobot_mj.plants.mujoco.model import wheel_inertia
from agrobot_mj.plants.mujoco.views import IMPLEMENT

IMPLEMENT_WHEELS = ("il", "ir")
"""Names of its wheels, left and right."""


def add_implement(spec: mujoco.MjSpec, hitched: HitchedBody, tractor: TractorParameters, native: bool) -> None:
    """Hang `hitched` to the tractor of `spec`; with `native` contact its tyres collide."""
    hitch = [-tractor.hitch_behind_m, 0.0, tractor.hitch_height_m]
    body = spec.body("chassis").add_body(name=IMPLEMENT, pos=hitch)
    body.explicitinertial = True
    body.mass, body.ipos, body.inertia = hitched.mass, list(hitched.centre), list(hitched.inertia)
    for joint in hitched.joints:
        limit, kind = in_unit_of(body, joint.limit), mujoco.mjtJoint.mjJNT_HINGE
        place = {"axis": list(joint.axis), "pos": list(joint.at)}
        body.add_joint(name=joint.name, type=kind, range=[-limit, limit], limited=LIMITED, **place)
    for shape in (*hitched.shapes, *_antenna(hitched)):
        draw(body, Panel(f"implement_{shape.name}", "box", shape.half, shape.at, shape.paint))
    if hitched.axle is not None:
        for wheel, side in zip(IMPLEMENT_WHEELS, (1, -1), strict=True):
            _add_wheel(body, hitched.axle, wheel, side, native)


def _antenna(hitched: HitchedBody) -> tuple[Shape, ...]:
    """Mast and antenna, where they stand on the implement."""
    if hitched.antenna is None:
        return ()
    x, y, z = hitched.antenna
    half = (z - hitched.centre[2]) / 2
    mast = Shape("mast", (0.015, 0.015, max(half, 0.01)), (x, y, z - half), "iron")
    return mast, Shape("antenna", (0.08, 0.08, 0.03), (x, y, z), "signal")


def _add_wheel(body: mujoco.MjsBody, axle: Axle, name: str, side: int, native: bool) -> None:
    wheel, (x, _, z) = axle.wheel, axle.at
    part = body.add_body(name=f"wheel_{name}", pos=[x, side * axle.track / 2, z])
    part.explicitinertial = True
    part.mass, part.ipos, part.inertia = wheel.mass, [0.0, 0.0, 0.0], wheel_inertia(wheel)
    part.add_joint(name=f"spin_{name}", type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0, 1, 0], armature=0.05)
    part.add_geom(
        name=f"tyre_{name}",
        type=mujoco.mjtGeom.mjGEOM_CYLINDER,
        size=[wheel.radius, wheel.width / 2, 0],
        quat=ACROSS,
        contype=int(native),
        conaffinity=int(native),
        condim=3,
        priority=1,
        material="rubber",
        mass=0,
        group=1,
    )
    for drawn in drawn_wheel(name, wheel.radius, wheel.width):
        draw(part, drawn)
