"""Functions common to all tyre laws: contact kinematics, relaxation, rolling resistance, and the wrench on the wheel.

The height grid under a wheel gives a patch frame (ground normal n, forward f, left l), the penetration and the sliding
velocities. If the load follows the carcass, the wheel is first displaced by the lateral deflection. The carcass is a
bristle with the deflection z and the damping time tau in each direction,

    dz/dt = v_slip - |v_x| z / sigma,        slip = (z + tau dz/dt) / sigma,

whose steady-state slip is the slip ratio or tan(slip angle). The response is first order over the relaxation length
sigma; at rest the bristle acts like a spring. The tyre law computes the force from slip and load, and z decreases if
the friction limit is exceeded. The bristle is integrated exactly over a step and therefore stable at any speed.

The stiffness c of the carcass spring is independent of the load; sigma is the slip stiffness at the current load
divided by c, so that a lightly loaded tyre relaxes faster. At a force F the deflection z is the sum of the elastic
deflection F / c and the slid distance z - F / c. Tread that slid before a load increase adheres again without
contributing force.

The longitudinal force of a driven wheel acts at the effective rolling radius r_e, which follows from the power balance:
the free radius minus a third of the deflection [Pacejka2012].
"""

from math import exp, tanh
from typing import NamedTuple

from agrobot_mj.core.kernels import kernel
from agrobot_mj.core.signals import Array
from agrobot_mj.core.vectors import Vector, cross, dot, minus, plus, scale, unit
from agrobot_mj.terrain.grid import Ground, height_and_gradient, rolling_at, surface_at
from agrobot_mj.tyres.base import Footing, TyreLaw
from agrobot_mj.tyres.bearing import Bearing, Tread
from agrobot_mj.tyres.envelope import envelope

LOAD, SLIP_ANGLE, SLIP_RATIO, FORCE_X, FORCE_Y, FRICTION_USE = range(6)
"""Indices of the reported tyre quantities of a wheel; the array of all wheels has the shape (4, 6)."""
CREEP_SPEED = 0.02
"""Speed [m/s] at which rolling resistance, soil resistance and pneumatic trail have 76 % of their full values."""


class TyreSet(NamedTuple):
    """Parameters of the four tyres, in the order fl, fr, rl, rr, for the compiled functions."""

    front: TyreLaw  # Law of the front tyres: a named tuple whose class selects the compiled code
    rear: TyreLaw  # Law of the rear tyres, of the same class
    radius: Array  # Free radius [m], shape (4,)
    stiffness: Array  # Vertical stiffness [N/m], shape (4,)
    damping: Array  # Vertical damping [N s/m], shape (4,)
    relaxation: Array
    """Longitudinal and lateral relaxation length [m], shape (4, 2): initially at static load, updated in each step."""
    springs: Array  # Longitudinal and lateral stiffness of the carcass, shape (4, 2) [N/m]
    twist_stiffness: Array  # Stiffness of the patch against turning [N m/rad], shape (4,), or 0 for no scrubbing moment
    twist_relaxation: Array  # Length over which rolling removes the twist of the patch [m], shape (4,)
    scrub_arm: Array  # Maximum scrubbing moment divided by grip times load [m], shape (4,)
    load_follows: bool
    """Whether the load acts at the contact patch, which the lateral force displaces, or else in the wheel plane."""
    bristle_damping: float  # Damping of the carcass divided by its stiffness, tau [s]
    rolling_resistance: float  # Rolling resistance moment divided by load times rolling radius [-]
    patch_half_length: Array  # Half the contact length [m], shape (4,)
    trail: float  # Pneumatic trail at small slip [m]
    cone_index: float  # Cone index of ground without a cone index [Pa]; 0 for laws that use no cone index
    bearing: Bearing  # Parameters of yielding soil, or `FIRM`
    treads: tuple[Tread, Tread]  # Geometry of a front and a rear tyre on yielding soil
    grip: Array  # Factor on the friction of each wheel [-], set by faults, shape (4,)
    carcass: Array  # Factors on slip stiffness and rolling resistance of each wheel [-], set by faults, shape (4, 2)


class WheelMotion(NamedTuple):
    """Position and motion of a wheel in world axes."""

    centre: Vector  # Position of the wheel centre [m]
    axle: Vector  # Unit vector along the axle, to the left
    velocity: Vector  # Velocity of the wheel centre [m/s]
    rotation: Vector  # Angular velocity [rad/s], including the spin about the axle


class ContactPatch(NamedTuple):
    """Contact of one wheel with the ground: frame, penetration and velocities."""

    penetration: float  # Penetration along the ground normal [m], positive in contact
    rate: float  # Rate of the penetration [m/s]
    n: Vector  # Ground normal in world axes
    f: Vector  # Forward direction in the ground plane, in world axes
    l: Vector  # noqa: E741
    """Direction to the left in the ground plane, in world axes."""
    arm: Vector  # Vector from the wheel centre to the patch [m]
    v_x: float  # Forward velocity of the patch over the ground [m/s], without the spin of the wheel
    v_y: float  # Velocity of the patch to the left, the lateral sliding velocity [m/s]
    spin: float  # Angular velocity about the axle [rad/s], forward rolling positive
    turn: float  # Angular velocity about the ground normal [rad/s]


@kernel
def down_in_wheel_plane(n: Vector, axle: Vector) -> Vector:
    """Return the unit vector in the plane of a wheel that points down to the ground, whose normal is `n`."""
    return unit(minus(scale(dot(n, axle), axle), n))


@kernel
def touches_plane(ground: Ground) -> bool:
    """Return whether wheels touch the ground as a plane: it is a plane, or a single cell, which may be twisted."""
    return ground.heights.size <= 4 or ground.planar


@kernel
def contact_plane(ground: Ground, radius: float, centre: Vector, axle: Vector) -> tuple[Vector, float]:
    """Return the ground normal at the contact point of a wheel, and the penetration along the normal [m]."""
    if not touches_plane(ground):
        return envelope(ground, radius, centre, axle)
    _, dx, dy = height_and_gradient(ground, centre[0], centre[1])
    n = unit((-dx, -dy, 1.0))
    down = down_in_wheel_plane(n, axle)
    height = height_and_gradient(ground, centre[0] + radius * down[0], centre[1] + radius * down[1])[0]
    return n, (height - centre[2] - radius * down[2]) * n[2]


@kernel
def find_patch(ground: Ground, radius: float, wheel: WheelMotion) -> ContactPatch:
    """Return the contact patch between the ground and a wheel with the free radius `radius` [m]."""
    axle, velocity, rotation = wheel.axle, wheel.velocity, wheel.rotation
    n, penetration = contact_plane(ground, radius, wheel.centre, axle)
    f = unit(cross(axle, n))
    left = cross(n, f)
    down = down_in_wheel_plane(n, axle)
    arm = scale(radius - penetration, down)
    # the patch moves with the axle, not with the tread: the spin does not move it over the ground
    spin = dot(rotation, axle)
    carrier = minus(rotation, scale(spin, axle))
    v = plus(velocity, cross(carrier, arm))
    return ContactPatch(penetration, -dot(v, n), n, f, left, arm, dot(v, f), dot(v, left), spin, dot(carrier, n))


@kernel
def lower_patch(patch: ContactPatch, share: float) -> ContactPatch:
    """Return the patch with its lever arm multiplied by `share` [-], for a wheel at the bottom of a rut."""
    p, arm = patch, scale(share, patch.arm)
    return ContactPatch(p.penetration, p.rate, p.n, p.f, p.l, arm, p.v_x, p.v_y, p.spin, p.turn)


@kernel
def moved_aside(patch: ContactPatch, axle: Vector, by: float) -> ContactPatch:
    """Return the patch displaced along the axle to the left by `by` [m]."""
    p, arm = patch, plus(patch.arm, scale(by, axle))
    return ContactPatch(p.penetration, p.rate, p.n, p.f, p.l, arm, p.v_x, p.v_y, p.spin, p.turn)


@kernel
def displace_wheel(wheel: WheelMotion, by: float) -> WheelMotion:
    """Return the wheel displaced along its axle to the left by `by` [m]."""
    return WheelMotion(plus(wheel.centre, scale(by, wheel.axle)), wheel.axle, wheel.velocity, wheel.rotation)


@kernel
def footing_of(tyres: TyreSet, i: int, ground: Ground, x: float, y: float) -> Footing:
    """Return friction, cone index and rolling resistance of the ground below wheel `i`, at (x, y) [m]."""
    friction, cone_index = surface_at(ground.surface, x, y)
    soil = cone_index if cone_index > 0.0 else tyres.cone_index
    return Footing(friction * tyres.grip[i], soil, rolling_at(ground.surface, x, y))


@kernel
def relax(z: float, v_slip: float, v_roll: float, sigma: float, dt: float) -> float:
    """Return the bristle deflection `z` [m] after `dt` [s], exact for constant sliding and rolling velocities [m/s]."""
    k = v_roll / sigma
    # at rest the exact solution would divide by zero: the bristle is a spring
    if k * dt < 1e-6:
        return z * (1.0 - k * dt) + v_slip * dt
    decay = exp(-k * dt)
    return z * decay + v_slip / k * (1.0 - decay)


@kernel
def soft_sign(v: float, width: float) -> float:
    """Return tanh(v / width), a smooth sign of `v`. Where tanh rounds to 1 or -1, this number is returned directly."""
    x = v / width
    if abs(x) > 20.0:
        return 1.0 if x > 0.0 else -1.0
    return tanh(x)


@kernel
def rolling_torque(tyres: TyreSet, i: int, load: float, r_e: float, spin: float, surface: float = 0.0) -> float:
    """Return the rolling resistance torque about the axle of wheel `i` [N m], which opposes the spin.

    `surface` is the rolling resistance coefficient of a named ground surface, or 0. A coefficient above 0 replaces the
    coefficient of the tyre, except in tyre laws with soil resistance.
    """
    own = tyres.cone_index > 0.0 or tyres.bearing.k_phi > 0.0 or surface <= 0.0
    share = (tyres.rolling_resistance if own else surface) * float(tyres.carcass[i, 1])
    return -share * load * r_e * soft_sign(spin * r_e, CREEP_SPEED)


@kernel
def add_wrench(wrench: Array, patch: ContactPatch, axle: Vector, at_patch: Vector, extra: Vector) -> None:
    """Write the force and the torque on a wheel, about the wheel centre, into `wrench` (6,) in world axes.

    `at_patch` contains the forces at the patch: forward, left and along the normal [N]. `extra` contains a forward
    force at the wheel centre [N], a torque about the axle [N m] and a moment about the normal [N m].
    """
    n, f = patch.n, patch.f
    f_x, f_y, load = at_patch
    push, axle_torque, moment = extra
    force = plus(plus(scale(f_x, f), scale(f_y, patch.l)), scale(load, n))
    torque = cross(patch.arm, force)
    for k in range(3):
        wrench[k] = force[k] + push * f[k]
        wrench[3 + k] = torque[k] + axle_torque * axle[k] + moment * n[k]
