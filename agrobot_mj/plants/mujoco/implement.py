"""Implement of the simulated tractor: MuJoCo model, inputs of the compiled loop, log columns, and antenna motion."""

from math import exp, inf, log1p, nan, radians, sqrt
from typing import Any

import mujoco
import numpy as np

from agrobot_mj.core.randomness import gauss_markov, stream
from agrobot_mj.core.signals import Array, Column
from agrobot_mj.machine.implements.base import Axle, DepthWheel, HitchedBody, Shape, Unevenness
from agrobot_mj.machine.implements.draught import ToolLaw
from agrobot_mj.machine.tractor import GRAVITY, TractorParameters
from agrobot_mj.plants.mujoco.bodywork import ACROSS, Panel, draw
from agrobot_mj.plants.mujoco.bodywork import wheel as drawn_wheel
from agrobot_mj.plants.mujoco.mechanism import LIMITED, in_unit_of
from agrobot_mj.plants.mujoco.model import wheel_inertia
from agrobot_mj.plants.mujoco.tools import MEMORIES, Attached
from agrobot_mj.plants.mujoco.views import IMPLEMENT
from agrobot_mj.tyres.base import TyreBase
from agrobot_mj.tyres.laws import tyre_set
from agrobot_mj.tyres.patch import TyreSet

IMPLEMENT_WHEELS = ("il", "ir")


def add_implement(spec: mujoco.MjSpec, hitched: HitchedBody, tractor: TractorParameters, native: bool) -> None:
    """Attach the implement `hitched` to the tractor `spec`. If `native` is true, MuJoCo contact carries its wheels."""
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
    """Return the shapes of mast and antenna, or an empty tuple if the antenna is on the tractor."""
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


STEPS_A_LENGTH, LENGTHS = 5, 2000
"""Number of draught samples per correlation length, and number of correlation lengths in a period of the pattern."""
AT_THE_STOP = radians(2.0)
"""Margin to the yaw stop of the drawbar below which the tractor has jackknifed [rad]. Assumed value: a pushed implement
does not return from this angle, and a towed implement does not reach this angle in a turn."""
NO_TOOL = ToolLaw(0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 1.0, 0.0, 0.0)

COLUMNS = (
    Column("implement_x", "m", "true working point of the implement (tool or axle), east"),
    Column("implement_y", "m", "true working point of the implement, north"),
    Column("implement_yaw", "rad", "true heading of the implement, from east, counter-clockwise, wrapped"),
    Column("hitch_angle", "rad", "heading of the implement minus heading of the tractor, left positive"),
    Column("hitch_pull", "N", "force of the tractor on the implement, forward along the tractor's heading"),
    Column("hitch_side", "N", "force of the tractor on the implement, to the left of the tractor's heading"),
    Column("hitch_lift", "N", "force of the tractor on the implement, upwards"),
    Column("draught", "N", "force of the soil on the tool, backwards along the implement; null without a tool"),
    Column("tool_side", "N", "force of the soil on the tool, to the left; null without a tool"),
    Column("tool_depth", "m", "depth of the tool; null without a tool"),
    Column("depth_wheel_load", "N", "load of the depth wheel; null without one"),
    *(
        Column(f"{quantity}_{wheel}", "N", f"{text}, the implement's wheel {wheel}; null without wheels")
        for quantity, text in (("load", "vertical load"), ("fy", "force on the wheel, left in the ground plane"))
        for wheel in IMPLEMENT_WHEELS
    ),
)
"""Log columns of a MuJoCo plant with an implement."""


def implement_tyres(axle: Axle | None, tyre: TyreBase, tractor: TractorParameters) -> TyreSet:
    """Return the parameters of the two tyres of an implement's axle, or of the tractor's tyres if there is no axle.

    The parameters are computed as for the rear tyres of a tractor with four equal wheels of this size and load.
    """
    if axle is None:
        return tyre_set(tyre, tractor)
    wheel = axle.wheel
    sizes = {"radius_m": wheel.radius, "width_m": wheel.width, "mass_kg": wheel.mass}
    springs: dict[str, float | None] = {"_stiffness_n_m": wheel.stiffness, "_damping_n_s_m": wheel.damping, "": None}
    wheels = {f"{end}_wheel_{name}": value for end in ("front", "rear") for name, value in sizes.items()}
    tyres = {f"{end}_tyre{name}": value for end in ("front", "rear") for name, value in springs.items()}
    weight = {"mass_kg": 4 * wheel.load / GRAVITY, "front_load_fraction": 0.5}
    whole = tyre_set(tyre.of_implement(), tractor.model_copy(update=wheels | tyres | weight))
    arrays: dict[str, Any] = {
        name: value[2:].copy() for name, value in whole._asdict().items() if isinstance(value, np.ndarray)
    }
    two = whole._replace(front=whole.rear, treads=(whole.treads[1], whole.treads[1]), **arrays)
    two.carcass[:] = axle.slip_stiffness, axle.rolling
    return two


def draught_pattern(unevenness: Unevenness, seed: int) -> tuple[Array, float]:
    """Return samples of the draught along the path, divided by the mean draught [-], shape (n,), and their spacing [m].

    The samples have a log-normal distribution and depend on `seed`.
    """
    if unevenness.share <= 0.0:
        return np.ones(1), 1.0
    whites = stream(seed, "implement.draught").standard_normal(STEPS_A_LENGTH * LENGTHS).tolist()
    spread, value, found = log1p(unevenness.share**2), whites[0], []
    for white in whites:
        found.append(exp(sqrt(spread) * value - spread / 2))
        value = gauss_markov(value, white, 1.0, STEPS_A_LENGTH)
    return np.array(found), unevenness.length / STEPS_A_LENGTH


def implement_data(
    hitched: HitchedBody | None, model: mujoco.MjModel, tyre: TyreBase, tractor: TractorParameters, seed: int
) -> Attached:
    """Return the implement data for the compiled loop; `hitched` is None for a tractor without an implement."""
    axle = hitched.axle if hitched else None
    names = IMPLEMENT_WHEELS if axle else ()
    uneven, step = draught_pattern(hitched.unevenness if hitched else Unevenness(), seed)
    fold_q, fold = fold_joint(hitched, model) if hitched else (-1, inf)
    return Attached(
        body=model.body(IMPLEMENT).id if hitched else 0,
        native=tyre.native is not None,
        working=hitched is not None and hitched.tool is not None,
        tool=(hitched.tool if hitched else None) or NO_TOOL,
        tip=hitched.tool_at if hitched else (0.0, 0.0, 0.0),
        depth_wheel=hitched.depth_wheel if hitched else DepthWheel(),
        uneven=uneven,
        uneven_step=step,
        wheels=np.array([model.body(f"wheel_{name}").id for name in names], dtype=np.int64),
        tyres=implement_tyres(axle, tyre, tractor),
        bristles=np.zeros((len(names), 4)),
        wheel_report=np.zeros((len(names), 6)),
        memory=np.zeros(MEMORIES),
        report=np.zeros(4),
        pull=np.zeros(3),
        point=hitched.point if hitched else (0.0, 0.0, 0.0),
        antenna=(hitched.antenna if hitched else None) or (nan, nan, nan),
        has_tool=hitched is not None and hitched.tool is not None,
        fold_q=fold_q,
        fold=fold,
    )


def fold_joint(hitched: HitchedBody, model: mujoco.MjModel) -> tuple[int, float]:
    """Return the index of the drawbar's yaw angle in qpos, and the jackknife angle [rad].

    Without a drawbar the index is -1 and the angle is infinite.
    """
    for joint in hitched.joints if hitched.axle else ():
        if joint.axis == (0.0, 0.0, 1.0):
            return int(model.joint(joint.name).qposadr[0]), joint.limit - AT_THE_STOP
    return -1, inf


def memories_of(parts: Attached) -> tuple[Array, ...]:
    """Return the arrays of the implement that a tick modifies in place, except the arrays of MjData."""
    return parts.bristles, parts.wheel_report, parts.tyres.relaxation, parts.memory, parts.report, parts.pull
