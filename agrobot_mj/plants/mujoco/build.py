"""Compilation of the MuJoCo model of a scenario's tractor, with all feasibility checks.

The creation of a plant starts with `build`. Studies check their runs by calling `build` alone, without settling or
kernels.

The checks include the numerical stability of the tractor and implement; error messages name the key and its limit. The
integration is explicit in the forces of tyres and soil. A mass m on a spring k and a damper c is then stable if 2 c dt
+ k dt^2 < 4 m. For several bodies 1 / m is replaced by the maximum eigenvalue of J M^-1 J', with the inertia matrix M
and the Jacobian J of all contact points in one direction. The constraints of the steering linkage are omitted, which is
conservative.
"""

from collections.abc import Iterator, Sequence
from math import inf, sqrt
from typing import Annotated, Any, Literal, NamedTuple

import mujoco
import numpy as np
from pydantic import Field

from agrobot_mj.core.contracts import check_type
from agrobot_mj.core.signals import WHEELS, Array, PointMass
from agrobot_mj.core.spec import Spec
from agrobot_mj.machine import Machine
from agrobot_mj.machine.fitting import fit_warnings
from agrobot_mj.machine.implements.base import DepthWheel, HitchedBody, ImplementBase, wheel_loads
from agrobot_mj.machine.implements.draught import DEEPEST, draught
from agrobot_mj.machine.tractor import AxleWheel, TractorParameters
from agrobot_mj.plants.mujoco.drawing import scene_of
from agrobot_mj.plants.mujoco.implement import add_implement, implement_data
from agrobot_mj.plants.mujoco.loads import GIVE
from agrobot_mj.plants.mujoco.model import simulation_model, tractor_spec
from agrobot_mj.plants.mujoco.payload import Chassis, check_payloads
from agrobot_mj.plants.mujoco.tools import Attached
from agrobot_mj.plants.scene import Scene
from agrobot_mj.terrain import Ground
from agrobot_mj.tyres import MagicFormula, Tyre
from agrobot_mj.tyres.base import Structure, TyreBase
from agrobot_mj.tyres.laws import tyre_set
from agrobot_mj.tyres.patch import TyreSet

LIMIT = 4.0  # Stability limit of (2 c dt + k dt^2) / m [-], with damping c, time step dt, stiffness k and mass m
FASTEST_M_S = 3.0  # Speed at which the draught is evaluated [m/s]: typical field speed
AT_LEAST = ("relaxation_radii", "relaxation_m")  # Suffixes of keys for which a larger value gives a softer spring
FRONT, REAR = np.array([1.0, 1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0, 1.0])


class Part(NamedTuple):
    """Springs or dampers at contact points, whose stiffness or damping is set by one scenario key."""

    key: str
    value: float | None  # Value of the key, or None if an external tyre or implement has no such key
    stiffness: Array  # Stiffness at each point [N/m], shape (n,)
    damping: Array  # Damping at each point [N s/m], shape (n,)


class Sprung(NamedTuple):
    """All springs and dampers that act along one axis at a set of contact points."""

    axis: int  # Direction: 0 forward, 1 to the left, 2 up
    bodies: tuple[int, ...]  # MuJoCo id of the body to which each point is attached
    points: Array  # Positions of the points in the initial position of the model [m], shape (n, 3)
    parts: tuple[Part, ...]  # Springs and dampers that act in parallel at the attachment points


def check_stability(model: mujoco.MjModel, tyres: TyreSet, tractor: TractorParameters, tyre: TyreBase) -> None:
    """Raise a ValueError with the key and its limit if the tractor's tyres are unstable at the model's time step."""
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    _check(model, data, _tyres(model, data, tyres, tractor, tyre), "this tractor and tyre")


def check_implement(model: mujoco.MjModel, spec: ImplementBase, hitched: HitchedBody, parts: Attached) -> None:
    """Raise a ValueError with the key and its limit if the implement is unstable at the model's time step."""
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    _check(model, data, (*_soil(data, spec, hitched, parts), *_axle(data, spec, hitched, parts)), "this implement")


def _check(model: mujoco.MjModel, data: mujoco.MjData, found: tuple[Sprung, ...], what: str) -> None:
    inertia, dt = np.zeros((model.nv, model.nv)), float(model.opt.timestep)
    mujoco.mj_fullM(model, data, inertia)
    for sprung in found:
        motion, jacobian = np.zeros((len(sprung.bodies), model.nv)), np.zeros((3, model.nv))
        for i, (body, point) in enumerate(zip(sprung.bodies, sprung.points, strict=True)):
            mujoco.mj_jac(model, data, jacobian, None, point, body)
            motion[i] = jacobian[sprung.axis]
        mobility = motion @ np.linalg.solve(inertia, motion.T)
        weights = [dt * dt * part.stiffness + 2.0 * dt * part.damping for part in sprung.parts]
        whole = _largest(mobility, np.sum(weights, axis=0))
        if not whole < LIMIT:
            alone = [_largest(mobility, weight) for weight in weights]
            limit = _limit(sprung.parts[int(np.argmax(alone))], LIMIT / whole)
            raise ValueError(f"{limit}; otherwise {what} would be unstable at physics_dt_s = {dt:g}")


def _limit(part: Part, share: float) -> str:
    if part.value is None:
        table = "plant.tyre" if part.key.startswith("plant.tyre") else "implement"
        return f"{table}: springs and dampers must be reduced to less than {share:.2g} times their values"
    if part.key.endswith(AT_LEAST):
        return f"{part.key}: must be at least {part.value / share:.2g}, got {part.value:g}"
    return f"{part.key}: must be below {part.value * share:.2g}, got {part.value:g}"


def _tyres(
    model: mujoco.MjModel, data: mujoco.MjData, tyres: TyreSet, tractor: TractorParameters, tyre: TyreBase
) -> tuple[Sprung, ...]:
    """Return the springs and dampers of the tractor's tyres in the vertical, longitudinal and lateral directions. The
    longitudinal carcass spring is attached to the rotating wheel, the other springs to the carrier of the wheel."""
    wheels = tuple(int(model.body(f"wheel_{name}").id) for name in WHEELS)
    carriers = tuple(int(model.body_parentid[body]) for body in wheels)
    points = data.xpos[list(wheels)] - np.outer(tyres.radius, [0.0, 0.0, 1.0])
    vertical = []
    for wheel, on in zip(tractor.wheels, (FRONT, REAR), strict=True):
        key = f"tractor.{wheel.axle}_tyre"
        vertical.append(Part(f"{key}_stiffness_n_m", wheel.stiffness, on * tyres.stiffness, 0.0 * on))
        vertical.append(Part(f"{key}_damping_n_s_m", wheel.damping, 0.0 * on, on * tyres.damping))
    found = [Sprung(2, carriers, points, tuple(vertical))]
    for axis, bodies, share in ((0, wheels, "carcass_longitudinal"), (1, carriers, "carcass_lateral")):
        key, k = share if hasattr(tyre, share) else "relaxation_radii", tyres.springs[:, axis]
        spring = Part(f"plant.tyre.{key}", _value(tyre, key), k, 0.0 * k)
        damper = Part(
            "plant.tyre.bristle_damping_s", _value(tyre, "bristle_damping_s"), 0.0 * k, tyres.bristle_damping * k
        )
        found.append(Sprung(axis, bodies, points, (spring, damper)))
    return tuple(found)


def _soil(data: mujoco.MjData, spec: ImplementBase, hitched: HitchedBody, parts: Attached) -> Iterator[Sprung]:
    origin, body, one = data.xpos[parts.body], (parts.body,), np.ones(1)
    if (law := hitched.tool) is not None:
        along, across = draught(law, FASTEST_M_S, law.depth) / GIVE, DEEPEST * law.cornering / law.relaxation
        for axis, key, k in ((0, "tool.draught_scale", along), (1, "tool.relaxation_m", across)):
            spring = Part(f"implement.{key}", _value(spec, key), k * one, 0.0 * one)
            yield Sprung(axis, body, origin + np.array([hitched.tool_at]), (spring,))
    if (wheel := hitched.depth_wheel).stiffness > 0.0:
        yield Sprung(2, body, origin + np.array([wheel.at]), _springs(spec, "depth_wheel", wheel, one))


def _axle(data: mujoco.MjData, spec: ImplementBase, hitched: HitchedBody, parts: Attached) -> Iterator[Sprung]:
    axle, tyres, two = hitched.axle, parts.tyres, np.ones(2)
    if axle is None or parts.native:
        return
    bodies = tuple(parts.wheels.tolist())
    points = data.xpos[list(bodies)] - np.array([0.0, 0.0, axle.wheel.radius])
    yield Sprung(2, bodies, points, _springs(spec, "tyre", axle.wheel, two))
    lateral = float(tyres.springs[0, 1]) * axle.slip_stiffness * two
    key = "slip_stiffness_scale"
    part = Part(f"implement.{key}", _value(spec, key), lateral, tyres.bristle_damping * lateral)
    yield Sprung(1, bodies, points, (part,))


def _springs(spec: ImplementBase, name: str, wheel: AxleWheel | DepthWheel, on: Array) -> tuple[Part, Part]:
    k, c = (f"{name}_stiffness_n_m", wheel.stiffness), (f"{name}_damping_n_s_m", wheel.damping)
    return (
        Part(f"implement.{k[0]}", _value(spec, *k), k[1] * on, 0.0 * on),
        Part(f"implement.{c[0]}", _value(spec, *c), 0.0 * on, c[1] * on),
    )


def _value(owner: Any, key: str, left_out: float | None = None) -> float | None:
    """Return the number at the dotted `key` of `owner`, `left_out` if the value is None, or None for a missing key."""
    for name in key.split("."):
        if not hasattr(owner, name):
            return None
        owner = getattr(owner, name)
    return left_out if owner is None else float(owner)


def _largest(mobility: Array, weights: Array) -> float:
    root = np.sqrt(weights)
    return float(np.linalg.eigvalsh(root[:, None] * mobility * root).max())


class Built(NamedTuple):
    """Compiled MuJoCo model of a tractor on its ground, with tyres and implement."""

    model: mujoco.MjModel
    scene: Scene
    tyres: TyreSet
    hitched: HitchedBody | None
    attached: Attached  # Data of the implement for the compiled kernels


Payloads = Sequence[tuple[int, tuple[PointMass, ...]]]
"""Sets of point masses on the chassis. Each set has the index of the fault whose start or end applies the set."""


def build(tyre: Tyre, machine: Machine, ground: Ground, dt: float, seed: int = 1, payloads: Payloads = ()) -> Built:
    """Return the compiled tractor on its ground, for physics steps of `dt` [s].

    `seed` determines the variation of the implement's draught. Raises a ValueError with the key if the tractor is
    numerically unstable, or if the tractor or one of the `payloads` is physically impossible.
    """
    tyres = tyre_set(tyre, machine.tractor)
    parts = tractor_spec(machine)
    hitched = machine.implement.hitched(machine.tractor)
    if hitched is not None:
        add_implement(parts, hitched, machine.tractor, tyre.native is not None)
    scene = scene_of(parts.compile())
    model = simulation_model(parts, ground, dt, tyre.native, drawn=False)
    if tyre.native is None:
        check_stability(model, tyres, machine.tractor, tyre)
    hung = implement_data(hitched, model, tyre, machine.tractor, seed)
    if hitched is not None:
        check_implement(model, machine.implement, hitched, hung)
    check_payloads(Chassis(model).bare, payloads)
    return Built(model, scene, tyres, hitched, hung)


LIGHT_STEP_S, FASTEST_TURN = 0.0025, 130.0
"""Physics step of `physics = "fast"` for light wheels [s], and angular frequency sqrt(2 k / m) above which a wheel of
mass m and tyre stiffness k counts as light [rad/s]. With steps of 5 ms light wheels vibrate, and a parked tractor
creeps at 0.2 mm/s. The threshold measured on a slope of 10 deg is between 121 and 138 rad/s."""


class Mujoco(Spec):
    """MuJoCo model of the tractor on its tyres (`[plant] kind = "mujoco"`)."""

    kind: Literal["mujoco"] = "mujoco"
    tyre: Tyre = MagicFormula()
    """Tyre model, selected by `plant.tyre.kind`."""
    settle_s: Annotated[float, Field(ge=0, le=120)] = 3.0
    """Minimum duration of settling on the tyres before the run [s], or 0 for no settling. Assumed value (range
    1-10)."""
    settle_limit_s: Annotated[float, Field(ge=0, le=600)] = 60.0
    """Maximum duration of settling [s], after which the run starts with a warning. Assumed value (range 20-120)."""

    def fast_step_s(self, tractor: TractorParameters) -> float:
        """Return the duration of a physics step [s] for the scenario setting `physics = "fast"`."""
        turn = max(sqrt(2.0 * wheel.stiffness / wheel.mass) for wheel in tractor.wheels)
        return min(self.tyre.fast_step_s, LIGHT_STEP_S if turn > FASTEST_TURN else inf)

    def hints(self, machine: Machine, speed: float) -> Iterator[str]:
        """Yield a message for each parameter that is implausible for the machine's weight or the path `speed` [m/s].

        Messages begin with the key. Raises ValueError or ScenarioError for an impossible machine or tyre.
        """
        tyre = self.tyre
        structure = check_type(tyre.structure(), Structure, "the tyre", tyre.kind, "structure")
        yield from fit_warnings(machine, structure.patch_half_length_m != 0.0, speed)
        loads = wheel_loads(machine.tractor, machine.implement.hitched(machine.tractor))
        yield from (f"plant.tyre.{line}" for line in tyre.hints(machine.tractor, loads))
