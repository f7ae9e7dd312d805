"""Forces on implements in the physics step: soil on a tool, and ground on a depth wheel.

The soil forces on a tool at the depth T, along and across its frame, are modelled by bristles (`tyres.patch.relax`).
The longitudinal force opposes the motion and reaches the draught within the distance `GIVE`. The lateral force follows

  dz/dt = v_y - |v_x| z / sigma,        F_y = -C z / sigma,        |F_y| at most the lateral force limit,

with the stiffness C and relaxation length sigma. In steady travel at the slip angle alpha, F_y = -C tan(alpha); at rest
the soil is a spring. Stiffness and limit are proportional to T divided by the intended depth. When a tool enters deeper
or harder soil, this soil has no deflection yet: the force is unchanged and the mean deflection decreases, so that no
motion of a tool gains energy. The suction is a downward force proportional to the draught. All forces act at half
depth.
"""

from math import atan2, floor, nan
from typing import NamedTuple

from agrobot_mj.core.geometry import to_heading, wrap
from agrobot_mj.core.kernels import kernel
from agrobot_mj.core.signals import Array, Index
from agrobot_mj.core.vectors import Vector, cross, minus, plus, to_world
from agrobot_mj.machine.implements.base import DepthWheel
from agrobot_mj.machine.implements.draught import ToolLaw, depth_ratio, draught
from agrobot_mj.plants.mujoco.loads import GIVE
from agrobot_mj.plants.mujoco.views import CHASSIS, Views
from agrobot_mj.terrain.grid import Ground, height_and_gradient
from agrobot_mj.tyres.patch import CREEP_SPEED, FORCE_Y, LOAD, TyreSet, relax, soft_sign

AHEAD, LEFT, TRAVELLED, RESISTED, ENGAGED = range(MEMORIES := 5)
"""Indices of a tool's state: soil deflections ahead and to the left [m] and working distance [m]; draught [N] and depth
divided by the intended depth [-] in the previous step."""
DRAUGHT, SIDE, DEPTH, WHEEL_LOAD = range(4)
"""Indices of an implement's report: soil draught and lateral force [N], depth [m] and depth-wheel load [N]."""


class Attached(NamedTuple):
    """Implement data for the compiled loop, which modifies the arrays."""

    body: int  # MuJoCo id of the implement's body, or 0 if there is no implement
    native: bool  # Whether MuJoCo contact carries the wheels
    working: bool  # Whether a tool is in the soil
    tool: ToolLaw
    tip: Vector  # Tip of the tool in the frame of the body [m]
    depth_wheel: DepthWheel
    uneven: Array  # Draught divided by its mean along the path [-], shape (n,)
    uneven_step: float  # Distance along the path between the entries of `uneven` [m]
    wheels: Index  # Body ids of the implement's wheels, shape (0,) or (2,)
    tyres: TyreSet  # Tyres of the implement's wheels, in the order of `wheels`
    bristles: Array  # Deflections of the tyres, shape (2, 4); see `stepping.Tyred`
    wheel_report: Array  # Report of the implement's tyres, shape (2, 6); see `tyres.patch`
    memory: Array  # State of the tool, shape (5,): see `AHEAD`
    report: Array  # Report of the implement, shape (4,): see `DRAUGHT`
    pull: Array  # Force of the tractor on the implement in the last tick, in world axes, shape (3,) [N]
    point: Vector  # Working point in the frame of the body [m]
    antenna: Vector  # GNSS antenna in the frame of the body [m], or NaN for an antenna on the tractor
    has_tool: bool  # Whether the implement has a tool
    fold_q: int  # Index of the yaw angle of the drawbar in qpos, or -1 without a drawbar
    fold: float  # Yaw angle of the drawbar above which the tractor has jackknifed [rad]


@kernel
def unevenness(uneven: Array, step: float, travelled: float) -> float:
    """Return the draught divided by its mean [-], interpolated at the working distance `travelled` [m] in a periodic
    pattern."""
    place = travelled / step
    k = floor(place)
    share, i = place - k, int(k) % uneven.size
    return float((1.0 - share) * uneven[i] + share * uneven[(i + 1) % uneven.size])


@kernel
def rescale(z: float, before: float, now: float) -> float:
    """Return the mean deflection of the soil [m] after its stiffness has changed from `before` to `now`.

    `z` is the deflection before the change [m]. Soil that is added has no deflection.
    """
    return z * before / now if now > before else z


@kernel
def soil_on_tool(law: ToolLaw, uneven: float, v_x: float, v_y: float, depth: float, dt: float, memory: Array) -> Vector:
    """Return the soil force on a tool (ahead, left, up) [N] at a velocity (v_x, v_y) [m/s] and depth [m]."""
    if depth <= 0.0:
        memory[AHEAD], memory[LEFT], memory[RESISTED], memory[ENGAGED] = 0.0, 0.0, 0.0, 0.0
        return 0.0, 0.0, 0.0
    speed = abs(v_x)
    memory[TRAVELLED] += speed * dt
    D, share = uneven * draught(law, speed, depth), depth_ratio(law, depth)
    ahead, left = rescale(memory[AHEAD], memory[RESISTED], D), rescale(memory[LEFT], memory[ENGAGED], share)
    memory[RESISTED], memory[ENGAGED] = D, share
    memory[AHEAD] = min(max(relax(ahead, v_x, speed, GIVE, dt), -GIVE), GIVE)
    z, limit = relax(left, v_y, speed, law.relaxation, dt), 0.0
    if law.cornering > 0.0:
        limit = law.side_limit * law.relaxation / law.cornering
    memory[LEFT] = min(max(z, -limit), limit)
    F_y = -law.cornering * share * memory[LEFT] / law.relaxation
    F_x = -D * memory[AHEAD] / GIVE
    return F_x, F_y, -law.suction * max(-F_x, 0.0)


@kernel
def carry_point(v: Views, body: int, at: Vector) -> tuple[Vector, Vector]:
    """Return the position [m] and velocity [m/s] in world axes of the point `at`, given in the body frame [m]."""
    o, c, m = v.xpos[body], v.root_com, v.cvel[body]
    place = plus((o[0], o[1], o[2]), to_world(v.xmat[body], at))
    # cvel is the velocity of the body at the tractor's centre of mass: transfer it to the point
    swing = cross((m[0], m[1], m[2]), minus(place, (c[0], c[1], c[2])))
    return place, plus((m[3], m[4], m[5]), swing)


@kernel
def implement_report(v: Views, a: Attached) -> tuple[float, ...]:
    """Return the current values of the implement's log columns, in the order of `implement.COLUMNS`."""
    R, T = v.xmat[a.body], v.xmat[CHASSIS]
    yaw, ahead = atan2(R[3], R[0]), atan2(T[3], T[0])
    (x, y, _), _ = carry_point(v, a.body, a.point)
    forward, left = to_heading(ahead, a.pull[0], a.pull[1])
    draught_force = side = depth = carried = left_load = right_load = left_fy = right_fy = nan
    if a.has_tool:
        draught_force, side, depth = a.report[DRAUGHT], a.report[SIDE], a.report[DEPTH]
    if a.depth_wheel.stiffness > 0.0:
        carried = a.report[WHEEL_LOAD]
    if a.wheels.size > 0:
        w = a.wheel_report
        left_load, right_load, left_fy, right_fy = w[0, LOAD], w[1, LOAD], w[0, FORCE_Y], w[1, FORCE_Y]
    return (
        x, y, yaw, wrap(yaw - ahead), forward, left, a.pull[2], draught_force, side, depth, carried, left_load,
        right_load, left_fy, right_fy,
    )  # fmt: skip


@kernel
def push_at(v: Views, body: int, place: Vector, force: Vector) -> None:
    """Add a force [N] at the position `place` [m] to the wrench on a body; both vectors are in world axes."""
    c, wrench = v.xipos[body], v.xfrc[body]
    torque = cross(minus(place, (c[0], c[1], c[2])), force)
    for k in range(3):
        wrench[k] += force[k]
        wrench[3 + k] += torque[k]


@kernel
def apply_soil(v: Views, a: Attached, ground: Ground, dt: float) -> None:
    """Add the soil force on the tool to the wrench on the implement's body."""
    R = v.xmat[a.body]
    (x, y, z), velocity = carry_point(v, a.body, a.tip)
    depth = height_and_gradient(ground, x, y)[0] - z
    v_x = R[0] * velocity[0] + R[3] * velocity[1] + R[6] * velocity[2]
    v_y = R[1] * velocity[0] + R[4] * velocity[1] + R[7] * velocity[2]
    uneven = unevenness(a.uneven, a.uneven_step, a.memory[TRAVELLED])
    f = soil_on_tool(a.tool, uneven, v_x, v_y, depth, dt, a.memory)
    push_at(v, a.body, (x, y, z + 0.5 * max(depth, 0.0)), to_world(R, f))
    a.report[DRAUGHT], a.report[SIDE], a.report[DEPTH] = -f[0], f[1], max(depth, 0.0)


@kernel
def roll_on(v: Views, a: Attached, ground: Ground) -> None:
    """Add the ground force on the depth wheel to the wrench on the implement's body."""
    wheel, R = a.depth_wheel, v.xmat[a.body]
    (x, y, z), velocity = carry_point(v, a.body, wheel.at)
    height, dx, dy = height_and_gradient(ground, x, y)
    rate = dx * velocity[0] + dy * velocity[1] - velocity[2]
    # the soil only pushes
    load = max(wheel.stiffness * (height - z) + wheel.damping * rate, 0.0) if height > z else 0.0
    ahead = R[0] * velocity[0] + R[3] * velocity[1] + R[6] * velocity[2]
    drag = -wheel.rolling * load * soft_sign(ahead, CREEP_SPEED)
    # normal to the ground, to first order in its slope
    push_at(v, a.body, (x, y, z), (drag * R[0] - dx * load, drag * R[3] - dy * load, drag * R[6] + load))
    a.report[WHEEL_LOAD] = load


@kernel
def apply_tools(v: Views, a: Attached, ground: Ground, dt: float) -> None:
    """Write the wrench of the tool and the depth wheel on the implement's body to `xfrc_applied`."""
    v.xfrc[a.body, :] = 0.0
    if a.working:
        apply_soil(v, a, ground, dt)
    if a.depth_wheel.stiffness > 0.0:
        roll_on(v, a, ground)
