"""Whether a tractor on its tyres is stable at the physics step: bounds of stiffness and damping, by name.

The tyres' forces are explicit in the velocity. A mass m on a spring k and a damper c is then stable while
2 c dt + k dt^2 < 4 m; on wheels 1 / m becomes J M^-1 J', with the inertia M and the motion J of all patches in one
direction, and its largest eigenvalue counts. The constraints of the steering linkage are left out, which errs on the
safe side.
"""

from typing import NamedTuple

import mujoco
import numpy as np

from agrobot_mj.core.signals import WHEELS, Array
from agrobot_mj.machine.tractor import TractorParameters
from agrobot_mj.tyres.base import TyreBase
from agrobot_mj.tyres.patch import TyreSet

LIMIT = 4.0
"""Stable below, see above [-]."""


class Carried(NamedTuple):
    """Stiffness and damping of the four tyres in one direction, with the keys that they come from."""

    axis: int
    """0 forward, 1 to the left, 2 up."""
    stiffness: Array
    """Shape (4,) [N/m]."""
    damping: Array
    """Shape (4,) [N s/m]."""
    keys: tuple[tuple[str, str], tuple[str, str]]
    """Keys of stiffness and damping, each front and rear."""


def check_stability(model: mujoco.MjModel, tyres: TyreSet, tractor: TractorParameters, tyre: TyreBase) -> None:
    """Raise ValueError, naming key and limit, where `tyres`, made of `tyre`, blow up at the model's time step."""
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    inertia = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, inertia)
    dt = float(model.opt.timestep)
    for carried in _directions(tyres, tyre):
        motion = _patch_motion(model, data, tyres, carried.axis)
        mobility = motion @ np.linalg.solve(inertia, motion.T)
        parts = dt * dt * carried.stiffness, 2.0 * dt * carried.damping
        whole = largest(mobility, parts[0] + parts[1])
        if not whole < LIMIT:
            alone = {
                key: largest(mobility, part * on)
                for part, keys in zip(parts, carried.keys, strict=True)
                for key, on in zip(keys, ((1, 1, 0, 0), (0, 0, 1, 1)), strict=True)
            }
            key = max(alone, key=lambda key: alone[key])
            table, name = (tractor, key[8:]) if key.startswith("tractor.") else (tyre, key[11:])
            value = getattr(table, name, None)
            if value is None:  # of the tractor's springs those left out follow from its size
                value = getattr(table, name.removesuffix("_n_m").removesuffix("_n_s_m"), None)
            raise ValueError(_refusal(key, value, LIMIT / whole, dt))


def _refusal(key: str, value: float | None, share: float, dt: float) -> str:
    if value is None:  # a tyre from outside, with keys of its own
        key, limit = "plant.tyre", f"its slip stiffness or damping must be below {share:.2g} of what it is"
    elif key.endswith("relaxation_radii"):
        limit = f"must be at least {value / share:.2g}, got {value:g}"
    else:
        limit = f"must be below {value * share:.2g}, got {value:g}"
    return f"{key}: {limit}, to be stable with this tractor and tyre at physics_dt_s = {dt:g}"


def _directions(tyres: TyreSet, tyre: TyreBase) -> list[Carried]:
    vertical = (
        ("tractor.front_tyre_stiffness_n_m", "tractor.rear_tyre_stiffness_n_m"),
        ("tractor.front_tyre_damping_n_s_m", "tractor.rear_tyre_damping_n_s_m"),
    )
    damping = ("plant.tyre.bristle_damping_s",) * 2
    found = [Carried(2, tyres.stiffness, tyres.damping, vertical)]
    for axis, share in ((0, "carcass_longitudinal"), (1, "carcass_lateral")):
        carcass = (f"plant.tyre.{share if hasattr(tyre, share) else 'relaxation_radii'}",) * 2
        k = tyres.springs[:, axis]
        found.append(Carried(axis, k, tyres.bristle_damping * k, (carcass, damping)))
    return found


def _patch_motion(model: mujoco.MjModel, data: mujoco.MjData, tyres: TyreSet, axis: int) -> Array:
    """Velocity of the four patches along an axis over the generalised velocity, shape (4, nv).

    Forward that is the sliding velocity, with the wheel's spin; else the patch does not turn with the wheel.
    """
    found, jacobian = np.zeros((4, model.nv)), np.zeros((3, model.nv))
    for i, name in enumerate(WHEELS):
        body = model.body(f"wheel_{name}").id
        carrier = body if axis == 0 else int(model.body_parentid[body])
        patch = data.xpos[body] - np.array([0.0, 0.0, tyres.radius[i]])
        mujoco.mj_jac(model, data, jacobian, None, patch, carrier)
        found[i] = jacobian[axis]
    return found


def largest(mobility: Array, weights: Array) -> float:
    """Largest eigenvalue of mobility times diagonal weights."""
    root = np.sqrt(weights)
    return float(np.linalg.eigvalsh(root[:, None] * mobility * root).max())
