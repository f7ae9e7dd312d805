"""What comparable software takes for the same, in the same process, side by side.

Each peer is one function that returns rows of the table; one whose package is not there raises ImportError.
"""

from collections.abc import Callable
from math import isfinite
from typing import Any

import numpy as np
from bench import drive_on, in_turn, moving

from agrobot_mj import load_scenario
from agrobot_mj.control.t2fnn import T2Fnn
from agrobot_mj.core.signals import TICK_S
from agrobot_mj.plants import MujocoPlant
from agrobot_mj.tyres import MagicFormula
from agrobot_mj.tyres.contact import Contact

STEPS_MS = (10.0, 8.0, 6.0, 5.0, 4.0, 3.0, 2.5, 2.0, 1.5, 1.0, 0.5)
"""Steps tried, the largest stable one counts [ms]."""
SPEED, STEERING, MANOEUVRE_S = 10.0, 0.05, 3.0
"""Speed [m/s], steering angle [rad] and length [s] of the drive that has to be stable."""


Row = tuple[str, str, str, str]
"""What is computed, ours, theirs, and theirs over ours."""


def multi_body() -> list[Row]:
    """A second of motion by CommonRoad's multi-body model, of 29 states on a plane, in Python, beside our plant."""
    from vehiclemodels.init_mb import init_mb
    from vehiclemodels.parameters_vehicle1 import parameters_vehicle1
    from vehiclemodels.vehicle_dynamics_mb import vehicle_dynamics_mb

    p = parameters_vehicle1()
    start = np.array(init_mb([0.0, 0.0, STEERING, SPEED, 0.0, 0.0, 0.0], p))

    def rate(x: np.ndarray) -> np.ndarray:
        return np.array(vehicle_dynamics_mb(x, [0.0, 0.0], p))

    def drive(step: float, seconds: float) -> np.ndarray:
        x = start
        for _ in range(round(seconds / step)):
            a = rate(x)
            b = rate(x + step / 2 * a)
            c = rate(x + step / 2 * b)
            x = x + step / 6 * (a + 2 * b + 2 * c + rate(x + step * c))
        return x

    def stable(step: float) -> bool:
        try:
            with np.errstate(all="ignore"):
                yaw_rate = float(drive(step, MANOEUVRE_S)[5])
        except (ArithmeticError, ValueError):
            return False
        return isfinite(yaw_rate) and abs(yaw_rate - settled) < 0.02 * abs(settled)

    settled = float(drive(STEPS_MS[-1] / 1e3, MANOEUVRE_S)[5])
    step = next(ms for ms in STEPS_MS if stable(ms / 1e3))
    plant = moving(MagicFormula(), load_scenario("straight_line").terrain.ground())
    ours, theirs = in_turn(lambda: drive_on(plant, 20), lambda: drive(step / 1e3, 0.1))
    theirs *= 10
    model = "CommonRoad's multi-body model (29 states, Python), RK4 at its largest stable step"
    mine, yours = f"{1e3 * ours:.1f} ms (2 ms steps)", f"{1e3 * theirs:.0f} ms ({step:g} ms steps)"
    return [(f"one second of vehicle motion; {model}", mine, yours, f"{theirs / ours:.0f}")]


def fuzzy() -> list[Row]:
    """An inference of an interval type-2 TSK system of 3 x 3 rules."""
    from pyit2fls import IT2FS, IT2TSK, max_s_norm, product_t_norm, tri_mf

    network = T2Fnn()
    state = network.init(0.1, 0.1)
    domain = np.linspace(-2.0, 2.0, 201)

    def sets(centres: np.ndarray) -> list[Any]:
        upper, lower = network.width_upper_1, network.width_lower_1
        return [
            IT2FS(domain, tri_mf, [c - upper, c, c + upper, 1.0], tri_mf, [c - lower, c, c + lower, 1.0])
            for c in centres
        ]

    system = IT2TSK(product_t_norm, max_s_norm)
    for name in ("x1", "x2"):
        system.add_input_variable(name)
    system.add_output_variable("tau_n")
    for i, first in enumerate(sets(state.c1)):
        for j, second in enumerate(sets(state.c2)):
            consequent = {"const": float(state.f[i, j]), "x1": 0.0, "x2": 0.0}
            system.add_rule([("x1", first), ("x2", second)], [("tau_n", consequent)])
    inputs = {"x1": 0.12, "x2": 0.08}
    infer, tick, theirs = in_turn(
        lambda: [network.infer(state, 0.12, 0.08) for _ in range(200)],
        lambda: [network.update(state, 0.12, 0.08, 0.05, TICK_S) for _ in range(200)],
        lambda: [system.evaluate(inputs) for _ in range(200)],
    )
    what = "one inference of 9 interval type-2 rules; PyIT2FLS (`IT2TSK`, EIASC), ours in closed form"
    ours = f"{infer / 200 * 1e6:.1f} us, {tick / 200 * 1e6:.1f} us with learning"
    return [(what, ours, f"{theirs / 200 * 1e6:.0f} us", f"{theirs / infer:.0f}")]


def native_contact() -> list[Row]:
    """A physics step on MuJoCo's own contact of cylinders with a height field, beside the tyre's kernel."""
    ours, native = moving(MagicFormula()), moving(Contact())
    states = {plant: plant.save() for plant in (ours, native)}

    def drive(plant: MujocoPlant) -> None:
        plant.restore(states[plant])
        drive_on(plant, 20)

    mine, theirs = in_turn(lambda: drive(ours), lambda: drive(native))
    steps = 20 * ours.samples.shape[1] / 1e6
    what = "one physics step of 2 ms on a height field of 200 x 200 nodes; MuJoCo's own contact of its cylinders"
    return [(what, f"{mine / steps:.1f} us", f"{theirs / steps:.1f} us", f"{theirs / mine:.1f}")]


PEERS: dict[str, Callable[[], list[Row]]] = {
    "commonroad-vehicle-models": multi_body,
    "pyit2fls": fuzzy,
    "mujoco": native_contact,
}
"""What is measured, by the package that it needs."""
