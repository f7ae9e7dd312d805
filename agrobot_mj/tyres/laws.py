"""From a tyre's configuration to the compiled kernel, and one wheel's step under any law."""

from math import atan

import numpy as np

from agrobot_mj.compiled import jit
from agrobot_mj.signals import Array
from agrobot_mj.terrain.grid import Ground
from agrobot_mj.tractor import TractorParameters
from agrobot_mj.tyres.linear import Linear, linear_force
from agrobot_mj.tyres.patch import (
    FORCE_X,
    FORCE_Y,
    LOAD,
    SLIP_ANGLE,
    SLIP_RATIO,
    TyreSet,
    add_wrench,
    find_patch,
    relax,
    rolling_torque,
)

LINEAR = 0
"""Code of the linear law."""


@jit
def force(law: int, coefficients: Array, slip_x: float, slip_y: float, load: float) -> tuple[float, float, float]:
    """Forces forward and left [N], and the share of the bristle that the grip can hold, by the law's code."""
    return linear_force(coefficients, slip_x, slip_y)


def tyre_set(tyre: Linear, tractor: TractorParameters) -> TyreSet:
    """The four tyres of a tractor."""
    radius = np.array([tractor.front_wheel_radius_m] * 2 + [tractor.rear_wheel_radius_m] * 2)
    relaxation = tyre.relaxation_radii * radius
    return TyreSet(
        law=LINEAR,
        coefficients=tyre.coefficients(),
        radius=radius,
        stiffness=np.array([tractor.front_tyre_stiffness_n_m] * 2 + [tractor.rear_tyre_stiffness_n_m] * 2),
        damping=np.array([tractor.front_tyre_damping_n_s_m] * 2 + [tractor.rear_tyre_damping_n_s_m] * 2),
        relaxation=np.stack([relaxation, relaxation], axis=1),
        bristle_damping=tyre.bristle_damping_s,
        rolling_resistance=tyre.rolling_resistance,
    )


@jit
def wheel_step(
    tyres: TyreSet,
    i: int,
    ground: Ground,
    centre: tuple[float, float, float],
    axle: tuple[float, float, float],
    velocity: tuple[float, float, float],
    rotation: tuple[float, float, float],
    dt: float,
    bristle: Array,
    wrench: Array,
    report: Array,
) -> None:
    """One wheel over one step: bristle (2,) in place; wrench (6,) about its centre and report (5,) written."""
    patch = find_patch(ground, tyres.radius[i], centre, axle, velocity, rotation)
    load = tyres.stiffness[i] * patch.penetration + tyres.damping[i] * patch.rate
    if patch.penetration <= 0.0 or load <= 0.0:
        bristle[:] = 0.0
        wrench[:] = 0.0
        report[:] = 0.0
        return
    r_e = tyres.radius[i] - patch.penetration / 3.0
    rim = patch.spin * r_e
    slide_x, slide_y = patch.v_x - rim, patch.v_y
    v_roll = max(abs(patch.v_x), 0.5 * abs(rim))
    sigma_x, sigma_y = tyres.relaxation[i, 0], tyres.relaxation[i, 1]
    z_x = relax(bristle[0], slide_x, v_roll, sigma_x, dt)
    z_y = relax(bristle[1], slide_y, v_roll, sigma_y, dt)
    tau = tyres.bristle_damping / dt
    slip_x = (z_x + tau * (z_x - bristle[0])) / sigma_x
    slip_y = (z_y + tau * (z_y - bristle[1])) / sigma_y
    f_x, f_y, held = force(tyres.law, tyres.coefficients[i], slip_x, slip_y, load)
    bristle[0], bristle[1] = held * z_x, held * z_y
    loaded = tyres.radius[i] - patch.penetration
    axle_torque = rolling_torque(tyres, load, r_e, patch.spin) - (r_e - loaded) * f_x
    add_wrench(wrench, patch, axle, f_x, f_y, load, axle_torque)
    report[LOAD], report[FORCE_X], report[FORCE_Y] = load, f_x, f_y
    report[SLIP_ANGLE] = atan(z_y / sigma_y)
    report[SLIP_RATIO] = -z_x / sigma_x
