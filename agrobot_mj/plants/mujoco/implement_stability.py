"""Whether soil and tyres of an implement are stable at the physics step, by the bound of `stability`."""

from typing import Any, NamedTuple

import mujoco
import numpy as np

from agrobot_mj.core.signals import Array
from agrobot_mj.machine.implements.base import HitchedBody, ImplementBase
from agrobot_mj.machine.implements.draught import DEEPEST, draught
from agrobot_mj.plants.mujoco.stability import LIMIT, largest
from agrobot_mj.plants.mujoco.tools import GIVE, Attached

FASTEST_M_S = 3.0
"""Speed at which the draught of the check is taken [m/s]: that of field work."""


class Sprung(NamedTuple):
    """Springs and dampers of an implement against the ground in one direction."""

    key: str
    """Key below `implement` that they come from."""
    grows: bool
    """Whether they grow with the key's value."""
    axis: int
    """0 forward, 1 to the left, 2 up."""
    bodies: tuple[int, ...]
    """Bodies that they act on, one for each."""
    places: Array
    """Where, in the frames of these bodies, shape (n, 3) [m]."""
    stiffness: float
    """Stiffness of one [N/m]."""
    damping: float
    """Damping of one [N s/m]."""


def check_implement(model: mujoco.MjModel, spec: ImplementBase, hitched: HitchedBody, parts: Attached) -> None:
    """Raise ValueError, naming key and limit, where the implement blows up at the model's time step."""
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    inertia = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, inertia)
    dt = float(model.opt.timestep)
    for sprung in (*_soil(hitched, parts), *_wheels(hitched, parts)):
        motion, jacobian = np.zeros((len(sprung.bodies), model.nv)), np.zeros((3, model.nv))
        for i, (body, place) in enumerate(zip(sprung.bodies, sprung.places, strict=True)):
            mujoco.mj_jac(model, data, jacobian, None, data.xpos[body] + place, body)
            motion[i] = jacobian[sprung.axis]
        weight = dt * dt * sprung.stiffness + 2.0 * dt * sprung.damping
        whole = largest(motion @ np.linalg.solve(inertia, motion.T), np.full(len(sprung.bodies), weight))
        if not whole < LIMIT:
            raise ValueError(_refusal(sprung, spec, LIMIT / whole, dt))


def _refusal(sprung: Sprung, spec: ImplementBase, share: float, dt: float) -> str:
    value: Any = spec
    for name in sprung.key.split("."):
        given = getattr(value, name, None)
        value = getattr(value, name.removesuffix("_n_m").removesuffix("_n_s_m"), None) if given is None else given
    key = f"implement.{sprung.key}" if isinstance(value, float) else "implement"
    if not isinstance(value, float):
        limit = f"its {sprung.key} must be stable; {share:.2g} of what it is would be"
    elif sprung.grows:
        limit = f"must be below {value * share:.2g}, got {value:g}"
    else:
        limit = f"must be at least {value / share:.2g}, got {value:g}"
    return f"{key}: {limit}, to be stable with this implement at physics_dt_s = {dt:g}"


def _soil(hitched: HitchedBody, parts: Attached) -> list[Sprung]:
    """Soil on the tool, and the depth wheel."""
    found, body = [], (parts.body,)
    if hitched.tool is not None:
        law, at = hitched.tool, np.array([hitched.tool_at])
        along = draught(law, FASTEST_M_S, law.depth) / GIVE
        found.append(Sprung("tool.draught_scale", True, 0, body, at, along, 0.0))
        across = DEEPEST * law.cornering / law.relaxation
        found.append(Sprung("tool.relaxation_m", False, 1, body, at, across, 0.0))
    if hitched.depth_wheel.stiffness > 0.0:
        wheel = hitched.depth_wheel
        at = np.array([wheel.at])
        found.append(Sprung("depth_wheel_stiffness_n_m", True, 2, body, at, wheel.stiffness, 0.0))
        found.append(Sprung("depth_wheel_damping_n_s_m", True, 2, body, at, wheel.stiffness, wheel.damping))
    return found


def _wheels(hitched: HitchedBody, parts: Attached) -> list[Sprung]:
    """Its own tyres: vertical, and the carcass to the side."""
    axle, tyres = hitched.axle, parts.tyres
    if axle is None or parts.native:
        return []
    bodies, at = tuple(parts.wheels.tolist()), np.array([[0.0, 0.0, -axle.radius]] * 2)
    lateral = float(tyres.springs[0, 1]) * axle.slip_stiffness
    return [
        Sprung("tyre_stiffness_n_m", True, 2, bodies, at, axle.stiffness, 0.0),
        Sprung("tyre_damping_n_s_m", True, 2, bodies, at, axle.stiffness, axle.damping),
        Sprung("slip_stiffness_scale", True, 1, bodies, at, lateral, tyres.bristle_damping * lateral),
    ]
