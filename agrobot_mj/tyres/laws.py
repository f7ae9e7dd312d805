"""Parameters of the four tyres for compiled functions, and the physics step of one wheel, common to all tyre laws."""

from math import atan, exp, sqrt

import numpy as np

from agrobot_mj.core.contracts import check_pair, check_type
from agrobot_mj.core.kernels import kernel
from agrobot_mj.core.signals import Array
from agrobot_mj.core.vectors import Vector, dot, plus
from agrobot_mj.machine.linkage import DRY_GRIP
from agrobot_mj.machine.tractor import TractorParameters
from agrobot_mj.terrain.grid import Ground
from agrobot_mj.terrain.memory import untouched_soil
from agrobot_mj.tyres.base import Footing, Slip, Structure, TyreBase, TyreForce, TyreLaw, slip_of_faster
from agrobot_mj.tyres.bearing import Bearing, Pressed, Tread, press
from agrobot_mj.tyres.patch import (
    CREEP_SPEED,
    FORCE_X,
    FORCE_Y,
    FRICTION_USE,
    LOAD,
    SLIP_ANGLE,
    SLIP_RATIO,
    ContactPatch,
    TyreSet,
    WheelMotion,
    add_wrench,
    displace_wheel,
    find_patch,
    footing_of,
    lower_patch,
    moved_aside,
    relax,
    rolling_torque,
    soft_sign,
)

TRAIL_SLIP = 0.1  # Lateral slip at which the pneumatic trail has decreased to 37 % [-]. Assumed value.
ROLLING = 0.2  # Rolling speed at which the carcass damping has half of its value at rest [m/s]. Assumed value.
LEAST_SHARE = 0.1
"""Minimum ground speed divided by the reference speed of the slip [-], which limits the reported slip ratio to 20."""
SMALL, SHORTEST = 1e-6, 1e-3
"""Slip at which the slip stiffness is evaluated [-], and minimum relaxation length of an almost unloaded tyre [m]."""
Pair = tuple[float, float]
RESTING = 0.001
"""Speed below which the reported slip ratio is the bristle deflection divided by the relaxation length [m/s]."""


def tyre_set(tyre: TyreBase, tractor: TractorParameters) -> TyreSet:
    """Return the parameters of the four tyres of a tractor for the compiled functions."""
    structure = check_type(tyre.structure(), Structure, "the tyre", tyre.kind, "structure")
    front, rear = check_pair(
        tyre.coefficients(tractor), "the law of a front and of a rear tyre", "the tyre", tyre.kind, "coefficients"
    )
    four = [wheel for wheel in tractor.wheels for _ in range(2)]
    radius, stiffness, damping, loads = (
        np.array([getattr(wheel, name) for wheel in four]) for name in ("radius", "stiffness", "damping", "load")
    )
    given = structure.patch_half_length_m
    patches = np.sqrt(2 * radius * loads / stiffness) if given is None else np.full(4, given)
    footing = Footing(1.0, structure.cone_index_pa)
    wheels = zip((front, front, rear, rear), loads, loads / stiffness, strict=True)
    K = np.array([slip_stiffness(law, load, sunk, footing, 0.0, 0.0) for law, load, sunk in wheels])
    # at least 1 N/m, for a law without a force in one direction
    springs = np.stack(
        [
            share * stiffness if share > 0.0 else np.maximum(K[:, axis] / (structure.relaxation_radii * radius), 1.0)
            for axis, share in enumerate(structure.carcass_share)
        ],
        axis=1,
    )
    widths = np.array([wheel.width for wheel in four])
    twist, twist_relaxation = brush(K[:, 0], patches, widths)
    return TyreSet(
        front=front,
        rear=rear,
        radius=radius,
        stiffness=stiffness,
        damping=damping,
        relaxation=np.maximum(K / springs, SHORTEST),
        springs=springs,
        twist_stiffness=twist,
        twist_relaxation=twist_relaxation,
        scrub_arm=widths / sqrt(8),
        load_follows=structure.load_follows,
        bristle_damping=structure.bristle_damping_s
        * (1.0 if any(structure.carcass_share) else structure.relaxation_radii / 1.5),
        rolling_resistance=structure.rolling_resistance,
        patch_half_length=patches,
        trail=structure.trail_m,
        cone_index=structure.cone_index_pa,
        bearing=structure.bearing,
        treads=treads(structure.bearing, tractor),
        grip=np.ones(4),
        carcass=np.ones((4, 2)),
    )


def brush(K_x: Array, a: Array, b: Array) -> tuple[Array, Array]:
    """Return the torsional stiffness of contact patches [N m/rad], and the distance in which rolling removes a twist
    [m].

    `K_x` are the slip stiffnesses [N], `a` and `b` the half lengths and widths of the patches [m]. At rest, bristles of
    stiffness c on an area 2 a times b have the slip stiffness K_x = 2 c a^2 and the torsional stiffness 2 c a (a^2 / 3
    + b^2 / 12). On a curved path, the bristles deflect in proportion to the curvature and to the distance from the
    wheel plane: the moment is K_x b^2 / 12 times the curvature.
    """
    half = np.where(a > 0.0, a, 1.0)
    stiffness = np.where(a > 0.0, K_x * (half / 3 + b**2 / (12 * half)), 0.0)
    return stiffness, b**2 * half / (4 * half**2 + b**2)


def with_soil_memory(ground: Ground, bearing: Bearing) -> Ground:
    """Return `ground`, with a soil memory for plastic soil in `bearing`. Raises ValueError for too small soil cells."""
    if bearing.k_phi <= 0.0:
        return ground
    try:
        return ground._replace(memory=untouched_soil(ground.extent, bearing.cell))
    except ValueError as error:
        raise ValueError(f"plant.tyre.{error}") from None


def treads(bearing: Bearing, tractor: TractorParameters) -> tuple[Tread, Tread]:
    """Return geometry and carcass stiffness of a front and a rear tyre, from the static deflections on firm ground."""
    found = []
    for wheel in tractor.wheels:
        R, b, sunk, crown = wheel.radius, wheel.width, wheel.deflection, bearing.crown_share * wheel.width
        s, l = np.meshgrid(np.linspace(-1, 1, 201) * np.sqrt(2 * R * sunk), np.linspace(-b / 2, b / 2, 201))  # noqa: E741
        depth = np.maximum(sunk - s**2 / (2 * R) - l**2 / (2 * crown), 0.0)
        found.append(Tread(R, b, crown, float(wheel.load / (depth.mean() * 2 * np.sqrt(2 * R * sunk) * b))))
    return found[0], found[1]


@kernel
def scrub(tyres: TyreSet, i: int, patch: ContactPatch, load: float, grip: float, dt: float, bristle: Array) -> float:
    """Return the scrubbing moment about the ground normal [N m], and update the twist of the patch `bristle[2]` [rad].

    The patch slides at the moment mu N b / sqrt(8), with the friction mu, load N and patch width b [Eaton2006].
    """
    stiffness = float(tyres.twist_stiffness[i])
    if stiffness <= 0.0:
        return 0.0
    twist = relax(bristle[2], patch.turn, abs(patch.v_x), float(tyres.twist_relaxation[i]), dt)
    limit = DRY_GRIP * grip * load * float(tyres.scrub_arm[i]) / stiffness
    bristle[2] = min(max(twist, -limit), limit)
    return float(-stiffness * bristle[2])


@kernel
def aligning(tyres: TyreSet, slip_y: float, f_y: float) -> float:
    """Return the aligning moment [N m]: the lateral force times the pneumatic trail, which decreases with the slip."""
    if tyres.trail <= 0.0:
        return 0.0
    return -tyres.trail * exp(-abs(slip_y) / TRAIL_SLIP) * f_y


@kernel
def slip_stiffness(law: TyreLaw, load: float, deflection: float, footing: Footing, area: float, length: float) -> Pair:
    """Return the longitudinal and the lateral slip stiffness [N], which is force divided by slip for small slip."""
    # both directions in one call, because they are independent at small slip
    force = law.force(Slip(-SMALL, -SMALL, load, deflection, 1.0, footing, 1.0, area, length))
    return force.x / SMALL, force.y / SMALL


@kernel
def adhering(slip: Slip, force: TyreForce, K: Pair) -> float:
    """Return the elastic fraction of the bristle deflection [-]: secant stiffness divided by slip stiffness."""
    full = K[0] * slip.x * slip.x + K[1] * slip.y * slip.y
    return min(-(force.x * slip.x + force.y * slip.y) / full, 1.0) if full > 0.0 else 1.0


@kernel
def direction_of_travel(v_x: float, rim: float) -> float:
    """Return 1 for forward travel and -1 for reverse travel, so that the slip ratio of a driven wheel is positive.

    A wheel that spins at standstill travels in the direction of its rim speed `rim` [m/s].
    """
    on_the_spot = abs(v_x) < LEAST_SHARE * 0.5 * abs(rim)
    return -1.0 if (rim if on_the_spot else v_x) < -RESTING else 1.0


@kernel
def rut_share(patch: ContactPatch, s: float) -> float:
    """Return a factor on the motion resistance of the soil for a wheel that also slides sideways [-].

    The factor of a rolling wheel (slip `s` = 0) is 1. For a locked or spinning wheel (`s` = 1) the factor is the
    squared cosine of the angle between velocity and wheel heading.
    """
    ahead, aside = patch.v_x * patch.v_x, patch.v_y * s
    return ahead / max(ahead + aside * aside, 1e-12)


@kernel
def carry(tyres: TyreSet, i: int, ground: Ground, patch: ContactPatch, centre: Vector, slip: float) -> Pressed:
    """Return the ground reaction on wheel `i` at a given longitudinal slip, from a tyre spring or yielding soil."""
    d = patch.penetration
    if d <= 0.0:
        return Pressed(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    if ground.memory.tiles.size == 0:
        return Pressed(tyres.stiffness[i] * d, 0.0, 0.0, 0.0, 0.0, d)
    tread = tyres.treads[0] if i < 2 else tyres.treads[1]
    return press(tyres.bearing, tread, ground.memory, plus(centre, patch.arm), (patch.n, patch.f, patch.l), d, slip)


@kernel
def held_share(slip: Slip, force: TyreForce, K: tuple[float, float], last_load: float) -> float:
    """Return the fraction of the bristle (carcass) deflection that remains after sliding [-].

    Sliding limits the deflection of a locked wheel. When the load increases, tread that has slid adheres again without
    deflection. With a deflection, the tread would return more energy than it received.
    """
    if slip.load <= last_load:
        return force.held
    return force.held * (1.0 - (1.0 - adhering(slip, force, K)) * (1.0 - last_load / slip.load))


@kernel
def slip_ratio(v_x: float, rim: float, v_roll: float, slip: float) -> float:
    """Return the slip ratio relative to the ground speed [-], positive when driving.

    `slip` is relative to the reference speed `v_roll` [m/s].
    """
    over = (v_roll + RESTING) / (max(abs(v_x), LEAST_SHARE * v_roll) + RESTING)
    return -direction_of_travel(v_x, rim) * slip * over


@kernel
def wheel_step(
    tyres: TyreSet,
    i: int,
    ground: Ground,
    wheel: WheelMotion,
    dt: float,
    bristle: Array,
    wrench: Array,
    report: Array,
    whole: bool = True,
) -> None:
    """Advance wheel `i` by one physics step of `dt` [s]; update its `bristle` (4,), `wrench` (6,) and `report` (6,).

    The wrench (force and torque) acts at the wheel centre. If `whole` is false, only the load in `report` is updated.
    """
    firm = float(tyres.carcass[i, 0])
    spring = firm * float(tyres.springs[i, 1])
    # the lateral deflection of the carcass displaces the contact; the axial component of the load deflects the carcass
    ring = displace_wheel(wheel, bristle[3])
    patch = find_patch(ground, tyres.radius[i], ring)
    lean = dot(wheel.axle, patch.n) if tyres.load_follows else 0.0
    slipped = min(abs(bristle[0]) / max(tyres.relaxation[i, 0], SHORTEST), 1.0)
    soil = carry(tyres, i, ground, patch, ring.centre, slipped)
    load = soil.load + tyres.damping[i] * patch.rate
    # the ground cannot pull: a wheel that rebounds faster than its damper allows has left the ground
    if soil.load <= 0.0 or load <= 0.0:
        bristle[:], wrench[:], report[:] = 0.0, 0.0, 0.0
        return
    deflection, loaded = soil.deflection, tyres.radius[i] - soil.deflection
    r_e = tyres.radius[i] - deflection / 3.0
    rim = patch.spin * r_e
    # a wheel spinning at standstill also renews its bristles, from one side: hence half the rim speed
    v_roll = max(abs(patch.v_x), 0.5 * abs(rim))
    footing = footing_of(tyres, i, ground, ring.centre[0] + patch.arm[0], ring.centre[1] + patch.arm[1])
    law = tyres.front if i < 2 else tyres.rear
    way, A, L = soft_sign(patch.v_x, CREEP_SPEED), soil.area, soil.length
    K = slip_stiffness(law, load, deflection, footing, A, L)
    sigma_x, sigma_y = max(K[0] / tyres.springs[i, 0], SHORTEST), max(K[1] / tyres.springs[i, 1], SHORTEST)
    tyres.relaxation[i, 0], tyres.relaxation[i, 1] = sigma_x, sigma_y
    z_x = relax(bristle[0], patch.v_x - rim, v_roll, sigma_x, dt)
    axial = lean * load / spring
    pushed = bristle[1] + axial
    z_y = relax(pushed, patch.v_y, v_roll, sigma_y, dt)
    # the carcass damping acts at rest, where nothing else damps the bristle, and fades with rolling speed
    tau = tyres.bristle_damping / (1.0 + v_roll / ROLLING) / dt
    slip_x, slip_y = (z_x + tau * (z_x - bristle[0])) / sigma_x, (z_y + tau * (z_y - pushed)) / sigma_y
    slip = Slip(slip_x, slip_y, load, deflection, v_roll, footing, way, A, L)
    softened = Slip(firm * slip_x, firm * slip_y, load, deflection, v_roll, footing, way, A, L)
    force = law.force(softened)
    push = law.drag(slip, way * rut_share(patch, slip_of_faster(slip))) + soil.push
    # sliding shortens both bristles as rolling does, so that the slip has the direction of the sliding velocity
    slid = (1.0 - held_share(softened, force, K, report[LOAD])) * max(sigma_x, sigma_y)
    bristle[0], bristle[1] = max(1.0 - slid / sigma_x, 0.0) * z_x, max(1.0 - slid / sigma_y, 0.0) * z_y - axial
    # the lever arm of the drive is r_e (power balance), that of the wrench is the loaded radius: the torque makes up
    axle_torque = rolling_torque(tyres, i, load, r_e, patch.spin, footing.rolling) - (r_e - loaded) * force.x
    moment = way * aligning(tyres, slip_y, force.y) + scrub(tyres, i, patch, load, footing.grip, dt, bristle)
    f_y = force.y + soil.edge
    held = lower_patch(patch, loaded / (tyres.radius[i] - patch.penetration))
    if tyres.load_follows:
        # without the force of the carcass damper
        bristle[3] = axial + force.y / spring + adhering(softened, force, K) * tau * (z_y - pushed)
        held = moved_aside(held, wheel.axle, bristle[3])
    add_wrench(
        wrench,
        held,
        wheel.axle,
        (force.x, f_y, load),
        (push, axle_torque, moment),
    )
    report[LOAD] = load
    if whole:
        report[FORCE_X], report[FORCE_Y], report[FRICTION_USE] = force.x + push, f_y, force.used
        report[SLIP_ANGLE] = atan(z_y / sigma_y)
        report[SLIP_RATIO] = slip_ratio(patch.v_x, rim, v_roll, z_x / sigma_x)
