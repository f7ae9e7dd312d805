"""Parts common to all tyre laws: contact kinematics, vertical load, relaxation, and the wrench at the patch.

One wheel reads the height grid below it and yields a patch frame (n the ground's normal, f forward, l left), the
penetration and the sliding velocities. The carcass is a bristle in each direction,

    dz/dt = v_slip - |v_x| z / sigma,        slip = (z + tau dz/dt) / sigma,

whose steady state is the slip ratio and tan(slip angle), whose response is first order over the relaxation length
sigma, and which holds like a spring at rest. A law turns slip and load into force; what exceeds its grip scales z
back. The bristle is integrated exactly over a step, so that it is stable at any speed.

The carcass is a spring whose stiffness c does not know the load; sigma is the slip stiffness at the present load over
it, so that a lightly loaded tyre relaxes sooner. With slip stiffness K and force F the bristle is part spring, F / c,
and part slid tread, z - F / c: what had slid before the load rose adheres again, and does not push.

A driven wheel's force acts with the effective rolling radius r_e as its lever (the arm that makes its power balance);
r_e lies a third of the deflection below the free radius [Pacejka2012].
"""

from math import exp, tanh
from typing import NamedTuple

from agrobot_mj.core.kernels import kernel
from agrobot_mj.core.signals import Array
from agrobot_mj.core.vectors import Vector, cross, dot, minus, plus, scaled, unit
from agrobot_mj.terrain.grid import Ground, height_and_gradient, surface_at
from agrobot_mj.tyres.base import Footing, TyreLaw
from agrobot_mj.tyres.bearing import Bearing, Tread
from agrobot_mj.tyres.envelope import envelope

LOAD, SLIP_ANGLE, SLIP_RATIO, FORCE_X, FORCE_Y, FRICTION_USE = range(6)
"""Indices of a wheel's report; the reports of all wheels have the shape (4, 6)."""
CREEP_SPEED = 0.02
"""Speed scale over which rolling and soil resistance and the pneumatic trail build up [m/s]."""


class TyreSet(NamedTuple):
    """Four tyres in the order fl, fr, rl, rr, as the compiled kernel takes them."""

    front: TyreLaw
    """Law of the front tyres, a named tuple whose class selects the compiled code."""
    rear: TyreLaw
    """Law of the rear tyres, of the same class."""
    radius: Array
    """Free radius, shape (4,) [m]."""
    stiffness: Array
    """Vertical stiffness, shape (4,) [N/m]."""
    damping: Array
    """Vertical damping, shape (4,) [N s/m]."""
    relaxation: Array
    """Longitudinal and lateral relaxation length, at first that at the static load, then as the last step has found it,
    shape (4, 2) [m]."""
    springs: Array
    """Longitudinal and lateral stiffness of the carcass, shape (4, 2) [N/m]."""
    twist_stiffness: Array
    """Stiffness of the patch against turning, shape (4,) [N m/rad]."""
    bristle_damping: float
    """Damping time tau of the bristle, see above [s]."""
    rolling_resistance: float
    """Rolling resistance moment divided by load times rolling radius [-]."""
    patch_half_length: Array
    """Lever arm of the scrubbing moment; 0 for none, shape (4,) [m]."""
    trail: float
    """Pneumatic trail at small slip; 0 for none [m]."""
    cone_index: float
    """Cone index for ground that does not give one; 0 for laws without [Pa]."""
    bearing: Bearing
    """Soil that sinks below the wheels."""
    treads: tuple[Tread, Tread]
    """A front and a rear tyre as that soil sees them."""
    grip: Array
    """Scale of each wheel's friction, written by faults, shape (4,) [-]."""
    carcass: Array
    """Scales of each wheel's slip stiffness and rolling resistance, written by faults, shape (4, 2) [-]."""


class WheelMotion(NamedTuple):
    """Position and motion of a wheel, world axes."""

    centre: Vector
    """Centre [m]."""
    axle: Vector
    """Unit vector along the axle, to the left."""
    velocity: Vector
    """Velocity of the centre [m/s]."""
    rotation: Vector
    """Angular velocity, spin included [rad/s]."""


class ContactPatch(NamedTuple):
    """Contact of one wheel with the ground: frame, penetration and velocities."""

    penetration: float
    """Penetration along n, positive when touching [m]."""
    rate: float
    """Rate of the penetration [m/s]."""
    n: Vector
    """Ground normal, world."""
    f: Vector
    """Forward direction in the ground plane, world."""
    l: Vector  # noqa: E741
    """Left direction in the ground plane, world."""
    arm: Vector
    """Vector from the wheel's centre to the patch [m]."""
    v_x: float
    """Velocity of the wheel's centre plane relative to the ground, forward [m/s]."""
    v_y: float
    """Velocity to the left, the lateral sliding velocity [m/s]."""
    spin: float
    """Angular velocity about the axle, forward rolling positive [rad/s]."""
    turn: float
    """Angular velocity about the ground's normal [rad/s]."""


@kernel
def down_in_wheel_plane(n: Vector, axle: Vector) -> Vector:
    """Return the downward direction in the plane of a wheel, against the normal `n`."""
    return unit(minus(scaled(dot(n, axle), axle), n))


@kernel
def contact_plane(ground: Ground, radius: float, centre: Vector, axle: Vector) -> tuple[Vector, float]:
    """Return the ground normal at the contact point of a wheel, and the penetration along the normal [m]."""
    if ground.heights.size > 4 and not ground.planar:
        return envelope(ground, radius, centre, axle)
    _, dx, dy = height_and_gradient(ground, centre[0], centre[1])
    n = unit((-dx, -dy, 1.0))
    down = down_in_wheel_plane(n, axle)
    height = height_and_gradient(ground, centre[0] + radius * down[0], centre[1] + radius * down[1])[0]
    return n, (height - centre[2] - radius * down[2]) * n[2]


@kernel
def find_patch(ground: Ground, radius: float, wheel: WheelMotion) -> ContactPatch:
    """Return the contact of a wheel of this free radius [m] with the ground."""
    axle, velocity, rotation = wheel.axle, wheel.velocity, wheel.rotation
    n, penetration = contact_plane(ground, radius, wheel.centre, axle)
    f = unit(cross(axle, n))
    left = cross(n, f)
    down = down_in_wheel_plane(n, axle)
    arm = scaled(radius - penetration, down)
    # the patch is fixed in the ground's plane, not on the tread: only what carries the axle sweeps it over the ground
    spin = dot(rotation, axle)
    carrier = minus(rotation, scaled(spin, axle))
    v = plus(velocity, cross(carrier, arm))
    return ContactPatch(penetration, -dot(v, n), n, f, left, arm, dot(v, f), dot(v, left), spin, dot(carrier, n))


@kernel
def lowered(patch: ContactPatch, share: float) -> ContactPatch:
    """Return the patch with its arm scaled by `share`: a sunken wheel's contact lies below the untouched ground."""
    p, arm = patch, scaled(share, patch.arm)
    return ContactPatch(p.penetration, p.rate, p.n, p.f, p.l, arm, p.v_x, p.v_y, p.spin, p.turn)


@kernel
def footing_of(tyres: TyreSet, i: int, ground: Ground, x: float, y: float) -> Footing:
    """Return the footing of wheel `i` at (x, y) [m]."""
    friction, cone_index = surface_at(ground.surface, x, y)
    return Footing(friction * tyres.grip[i], cone_index if cone_index > 0.0 else tyres.cone_index)


@kernel
def relax(z: float, v_slip: float, v_roll: float, sigma: float, dt: float) -> float:
    """Return the deflection of the bristle after a step, exact for constant velocities."""
    k = v_roll / sigma
    # at rest the exact solution divides by zero: there the bristle is a plain spring
    if k * dt < 1e-6:
        return z * (1.0 - k * dt) + v_slip * dt
    decay = exp(-k * dt)
    return z * decay + v_slip / k * (1.0 - decay)


@kernel
def soft_sign(v: float, width: float) -> float:
    """Return a smooth sign of `v` with transition `width`: tanh(v / width), skipped where it rounds to 1."""
    x = v / width
    if abs(x) > 20.0:
        return 1.0 if x > 0.0 else -1.0
    return tanh(x)


@kernel
def rolling_torque(tyres: TyreSet, i: int, load: float, r_e: float, spin: float) -> float:
    """Return the rolling resistance of wheel `i` about the axle, against the spin [N m]."""
    share = tyres.rolling_resistance * float(tyres.carcass[i, 1])
    return -share * load * r_e * soft_sign(spin * r_e, CREEP_SPEED)


@kernel
def add_wrench(wrench: Array, patch: ContactPatch, axle: Vector, at_patch: Vector, extra: Vector) -> None:
    """Write force and torque about the wheel's centre into `wrench` (6,), world.

    `at_patch`: forces forward, left and up the normal at the patch [N]; `extra`: a forward force on the centre [N], a
    torque about the axle and a moment about the normal [N m].
    """
    n, f = patch.n, patch.f
    f_x, f_y, load = at_patch
    push, axle_torque, moment = extra
    force = plus(plus(scaled(f_x, f), scaled(f_y, patch.l)), scaled(load, n))
    torque = cross(patch.arm, force)
    for k in range(3):
        wrench[k] = force[k] + push * f[k]
        wrench[3 + k] = torque[k] + axle_torque * axle[k] + moment * n[k]
