"""Compiled model of the MuJoCo tractor of a scenario, with all feasibility checks.

The running plant starts with `build`. Plans of many runs use only `build`, without settling or compiled kernels.
"""

from collections.abc import Iterator, Sequence
from math import inf, sqrt
from typing import Annotated, Literal, NamedTuple

import mujoco
from pydantic import Field

from agrobot_mj.core.contracts import check_type
from agrobot_mj.core.signals import PointMass
from agrobot_mj.core.spec import Spec
from agrobot_mj.machine import Machine
from agrobot_mj.machine.fitting import fit_warnings
from agrobot_mj.machine.implements.base import HitchedBody, wheel_loads
from agrobot_mj.machine.tractor import TractorParameters
from agrobot_mj.plants.mujoco.drawing import scene_of
from agrobot_mj.plants.mujoco.implement import add_implement, attached
from agrobot_mj.plants.mujoco.model import simulation_model, tractor_spec
from agrobot_mj.plants.mujoco.payload import Chassis, check_payloads
from agrobot_mj.plants.mujoco.stability import check_implement, check_stability
from agrobot_mj.plants.mujoco.tools import Attached
from agrobot_mj.plants.scene import Scene
from agrobot_mj.terrain import Ground
from agrobot_mj.tyres import MagicFormula, Tyre
from agrobot_mj.tyres.base import Structure
from agrobot_mj.tyres.laws import tyre_set
from agrobot_mj.tyres.patch import TyreSet


class Built(NamedTuple):
    """Compiled tractor on its ground."""

    model: mujoco.MjModel
    scene: Scene
    tyres: TyreSet
    hitched: HitchedBody | None
    attached: Attached
    """Implement as input of the compiled kernels."""


Payloads = Sequence[tuple[int, tuple[PointMass, ...]]]
"""Each set of masses carried by the chassis, with the index of the fault that adds them."""


def build(tyre: Tyre, machine: Machine, ground: Ground, dt: float, seed: int = 1, payloads: Payloads = ()) -> Built:
    """Return the tractor on its ground for a physics step of `dt` [s]; `seed` is that of the soil under the implement.

    Raise ValueError with the key if the tractor is impossible, also with any of the `payloads`, or unstable at this
    step.
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
    hung = attached(hitched, model, tyre, machine.tractor, seed)
    if hitched is not None:
        check_implement(model, machine.implement, hitched, hung)
    check_payloads(Chassis(model).bare, payloads)
    return Built(model, scene, tyres, hitched, hung)


LIGHT_STEP_S, FASTEST_TURN = 0.0025, 130.0
"""Physics step of `physics = "fast"` for light wheels [s], and angular frequency sqrt(2 k / m) of a disc rotating on
its tyre above which this step is used [rad/s]. At 5 ms light wheels vibrate, and a parked tractor creeps by 0.2 mm/s.
The threshold measured on 10 deg is between 121 and 138."""


class Mujoco(Spec):
    """MJCF tractor on its tyres; `[plant] kind = "mujoco"`."""

    kind: Literal["mujoco"] = "mujoco"
    tyre: Tyre = MagicFormula()
    """Tyre model, selected by `plant.tyre.kind`."""
    settle_s: Annotated[float, Field(ge=0, le=120)] = 3.0
    """Minimum settling time on the tyres before the run [s]; 0: no settling. Assumed value (1-10)."""
    settle_limit_s: Annotated[float, Field(ge=0, le=600)] = 60.0
    """Maximum settling time [s]; the run of a tractor still in motion starts with a warning. Assumed value (20-120)."""

    def fast_step_s(self, tractor: TractorParameters) -> float:
        """Return the duration of a physics step with `physics = "fast"` [s]."""
        turn = max(sqrt(2.0 * wheel.stiffness / wheel.mass) for wheel in tractor.wheels)
        return min(self.tyre.fast_step_s, LIGHT_STEP_S if turn > FASTEST_TURN else inf)

    def hints(self, machine: Machine, speed: float) -> Iterator[str]:
        """Yield hints, each beginning with its key, on values that do not suit the machine's weight at the path `speed`
        [m/s]. Raise ValueError or ScenarioError for an impossible machine or tyre."""
        tyre = self.tyre
        structure = check_type(tyre.structure(), Structure, "the tyre", tyre.kind, "structure")
        yield from fit_warnings(machine, structure.patch_half_length_m != 0.0, speed)
        loads = wheel_loads(machine.tractor, machine.implement.hitched(machine.tractor))
        yield from (f"plant.tyre.{line}" for line in tyre.hints(machine.tractor, loads))
