"""From a tyre's configuration to the compiled kernel, and one wheel's step under any law."""

from math import atan, exp

import numpy as np

from agrobot_mj.core.kernels import kernel
from agrobot_mj.core.signals import Array
from agrobot_mj.core.vectors import Vector
from agrobot_mj.machine.tractor import TractorParameters
from agrobot_mj.terrain.grid import Ground
from agrobot_mj.tyres.linear import Linear, linear_force
from agrobot_mj.tyres.magic_formula import MagicFormula, magic_force
from agrobot_mj.tyres.patch import (
    FORCE_X,
    FORCE_Y,
    FRICTION_USE,
    LOAD,
    SLIP_ANGLE,
    SLIP_RATIO,
    ContactPatch,
    Footing,
    TyreSet,
    add_wrench,
    find_patch,
    footing_of,
    relax,
    rolling_torque,
    soft_sign,
)
from agrobot_mj.tyres.soil import OWN_LOSS, Soil, drive_slip, resistance, soil_force

LINEAR, MAGIC_FORMULA, SOIL = range(3)
"""Codes of the laws in the kernel."""
SLIDE = 0.1
"""Twist at which the patch slides all over [rad]. Estimate."""
GRIP = 0.75
"""Friction under a scrubbing patch [-]. Estimate (0.6-0.8 in the field)."""
TRAIL_SLIP = 0.1
"""Lateral slip over which the pneumatic trail falls to 37 % [-]. Estimate."""
ROLLING = 0.2
"""The carcass' own damping fades over this speed: a rolling tyre is damped by its relaxation [m/s]. Estimate."""
STILL = 0.02
"""Soil resistance and pneumatic trail build up over this speed [m/s]."""


@kernel
def force(
    law: int,
    coefficients: Array,
    slip_x: float,
    slip_y: float,
    load: float,
    deflection: float,
    v_roll: float,
    footing: Footing,
) -> tuple[float, float, float, float]:
    """Forces forward and left [N], share of the bristle that the grip can hold, share of the grip in use; by `law`."""
    if law == MAGIC_FORMULA:
        return magic_force(coefficients, slip_x, slip_y, load, v_roll, footing.grip)
    if law == SOIL:
        return soil_force(coefficients, slip_x, slip_y, load, deflection, v_roll, footing)
    return linear_force(coefficients, slip_x, slip_y)


@kernel
def drag(
    law: int, coefficients: Array, slip_x: float, load: float, deflection: float, v_x: float, footing: Footing
) -> float:
    """Force of the ground's own resistance on the wheel's centre, forward [N]: of soil only."""
    if law == SOIL:
        share = soft_sign(v_x, STILL)
        return -share * resistance(coefficients, footing.cone_index, load, deflection, drive_slip(slip_x))
    return 0.0


def tyre_set(tyre: Linear | MagicFormula | Soil, tractor: TractorParameters) -> TyreSet:
    """The four tyres of a tractor."""
    radius = np.array([tractor.front_wheel_radius_m] * 2 + [tractor.rear_wheel_radius_m] * 2)
    relaxation = tyre.relaxation_radii * radius
    if isinstance(tyre, Soil):
        law, coefficients, rolling, half, trail = (
            SOIL,
            tyre.coefficients(tractor),
            OWN_LOSS,
            tyre.patch_half_length_m,
            0.0,
        )
    elif isinstance(tyre, MagicFormula):
        law, coefficients, rolling = MAGIC_FORMULA, tyre.coefficients(), tyre.rolling_resistance
        half, trail = tyre.patch_half_length_m, tyre.trail_m
    else:
        law, coefficients, rolling, half, trail = LINEAR, tyre.coefficients(), tyre.rolling_resistance, 0.0, 0.0
    return TyreSet(
        law=law,
        coefficients=coefficients,
        radius=radius,
        stiffness=np.array([tractor.front_tyre_stiffness_n_m] * 2 + [tractor.rear_tyre_stiffness_n_m] * 2),
        damping=np.array([tractor.front_tyre_damping_n_s_m] * 2 + [tractor.rear_tyre_damping_n_s_m] * 2),
        relaxation=np.stack([relaxation, relaxation], axis=1),
        bristle_damping=tyre.bristle_damping_s * tyre.relaxation_radii / 1.5,
        rolling_resistance=rolling,
        patch_half_length=half,
        trail=trail,
        cone_index=1e3 * tyre.cone_index_kpa if isinstance(tyre, Soil) else 0.0,
        grip=np.ones(4),
        carcass=np.ones((4, 2)),
    )


@kernel
def scrub(tyres: TyreSet, patch: ContactPatch, load: float, grip: float, dt: float, bristle: Array) -> float:
    """Moment about the ground's normal against turning on the spot [N m]; the third bristle is a twist [rad].

    The patch twists until its rim slides, over a bristle deflection of `SLIDE` times its half length, and then holds
    two thirds of grip times load times half length; rolling wipes the twist out over the patch's length.
    """
    a = tyres.patch_half_length
    if a <= 0.0:
        return 0.0
    twist = relax(bristle[2], patch.turn, abs(patch.v_x), 2.0 * a, dt)
    bristle[2] = min(max(twist, -SLIDE), SLIDE)
    return float(-2.0 / 3.0 * GRIP * grip * load * a * bristle[2] / SLIDE)


@kernel
def aligning(tyres: TyreSet, slip_y: float, f_y: float) -> float:
    """Aligning moment [N m]: the lateral force behind the patch's centre by a trail that slip uses up."""
    if tyres.trail <= 0.0:
        return 0.0
    return -tyres.trail * exp(-abs(slip_y) / TRAIL_SLIP) * f_y


@kernel
def wheel_step(
    tyres: TyreSet,
    i: int,
    ground: Ground,
    centre: Vector,
    axle: Vector,
    velocity: Vector,
    rotation: Vector,
    dt: float,
    bristle: Array,
    wrench: Array,
    report: Array,
) -> None:
    """One wheel over one step: bristle (3,) in place; wrench (6,) about its centre and report (6,) written."""
    patch = find_patch(ground, tyres.radius[i], centre, axle, velocity, rotation)
    load = tyres.stiffness[i] * patch.penetration + tyres.damping[i] * patch.rate
    if patch.penetration <= 0.0 or load <= 0.0:
        bristle[:] = 0.0
        wrench[:] = 0.0
        report[:] = 0.0
        return
    r_e = tyres.radius[i] - patch.penetration / 3.0
    rim = patch.spin * r_e
    v_roll = max(abs(patch.v_x), 0.5 * abs(rim))
    sigma_x, sigma_y = tyres.relaxation[i, 0], tyres.relaxation[i, 1]
    z_x = relax(bristle[0], patch.v_x - rim, v_roll, sigma_x, dt)
    z_y = relax(bristle[1], patch.v_y, v_roll, sigma_y, dt)
    tau = tyres.bristle_damping / (1.0 + v_roll / ROLLING) / dt
    slip_x = (z_x + tau * (z_x - bristle[0])) / sigma_x
    slip_y = (z_y + tau * (z_y - bristle[1])) / sigma_y
    c, firm = tyres.coefficients[i], tyres.carcass[i, 0]
    footing = footing_of(tyres, i, ground, centre[0] + patch.arm[0], centre[1] + patch.arm[1])
    f_x, f_y, held, used = force(tyres.law, c, firm * slip_x, firm * slip_y, load, patch.penetration, v_roll, footing)
    bristle[0], bristle[1] = held * z_x, held * z_y
    loaded = tyres.radius[i] - patch.penetration
    axle_torque = rolling_torque(tyres, i, load, r_e, patch.spin) - (r_e - loaded) * f_x
    moment = scrub(tyres, patch, load, footing.grip, dt, bristle) + soft_sign(patch.v_x, STILL) * aligning(
        tyres, slip_y, f_y
    )
    push = drag(tyres.law, c, slip_x, load, patch.penetration, patch.v_x, footing)
    add_wrench(wrench, patch, axle, (f_x, f_y, load), (push, axle_torque, moment))
    report[LOAD], report[FORCE_X], report[FORCE_Y] = load, f_x + push, f_y
    report[SLIP_ANGLE] = atan(z_y / sigma_y)
    report[SLIP_RATIO] = -z_x / sigma_x
    report[FRICTION_USE] = used
