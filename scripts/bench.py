"""Cost of a run compared with bare MuJoCo, cost of recording, time of each part of a tick, and start-up times.

Runs in one process, compiled code warm. The alternatives are timed in turn, and a ratio is the median of the ratios of
neighbours, so that a machine that is busy or changes its clock slows both. Times are processor times of all threads, in
which waiting for a busy machine does not count, those of start-up excepted. They are for information; only ratios can
be compared between machines.
"""

import argparse
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from copy import copy
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple
from unittest.mock import patch

import mujoco
import numpy as np

from agrobot_mj import load_scenario, run
from agrobot_mj.control.pid import SpeedLoop, SteeringLoop
from agrobot_mj.core.signals import Drive
from agrobot_mj.core.spec import every, members
from agrobot_mj.machine.hydraulics import NEUTRAL_V
from agrobot_mj.machine.implements import Drawn, Implement, ImplementBase, NoImplement
from agrobot_mj.plants import Mujoco, MujocoPlant
from agrobot_mj.plants.mujoco.model import simulation_model, tractor_spec
from agrobot_mj.plants.mujoco.saving import MujocoState
from agrobot_mj.recording import Recording
from agrobot_mj.scenario.schema import Scenario
from agrobot_mj.simulation import loop as simulate
from agrobot_mj.simulation import stepping
from agrobot_mj.simulation.log import Rows
from agrobot_mj.simulation.stepping import Simulation
from agrobot_mj.terrain import Ground
from agrobot_mj.tyres import Tyre
from agrobot_mj.tyres.bearing import FIRM

AIM_RATIO, AIM_RECORDING = 1.9, 0.10
"""The project's aims: closed loop over bare step, and what recording adds [-]."""
AIM_REAL_TIME = 160.0
"""Aim for simulated over wall time, on one core [-]."""
AIM_TYRE, AIM_SINKING, GRID = 1.3, 1.6, 200
"""Aims for physics with tyres over a bare step, on firm ground and on soil that sinks, and the nodes of its ground each
way [-]."""
START_UP = {"--version": 0.4, "--help": 0.4, "list": 0.4, "run circle --set duration_s=1": 2.0}
"""Command lines and the aims for their wall times [s]."""
UNDISTURBED = 10
"""Percentile of the ticks, and of as many bare steps, that counts as undisturbed by other work on the machine [%]."""
HELD_STEPS = 500
"""Number of steps after which the bare model restarts: held tyre forces balance it only for a while."""
MOVING_S = 12.0
"""Simulated time after which the tractor moves at its speed [s]."""


class BareModel:
    """The run's own model and a moving tractor in it, held up by the tyre forces of one moment."""

    def __init__(self, scenario: Scenario) -> None:
        loop = simulate.Loop(scenario)
        if not isinstance(loop.plant, MujocoPlant):
            raise TypeError("the bare step is that of a MuJoCo plant")
        for _ in range(round(MOVING_S / simulate.TICK_S)):
            loop.advance(loop.tick().drive)
        self.scenario, self.model, self.data = scenario, loop.plant.model, loop.plant.data
        self.kind = mujoco.mjtState.mjSTATE_INTEGRATION
        self.start = np.empty(mujoco.mj_stateSize(self.model, self.kind))
        mujoco.mj_getState(self.model, self.data, self.start, self.kind)

    def as_drawn(self) -> "BareModel":
        """A copy with all that is drawn, and all of MuJoCo's stages: the file as anybody would load it."""
        s, whole = self.scenario, copy(self)
        if not isinstance(s.implement, NoImplement):
            raise TypeError("the drawn model is that of a tractor without an implement")
        parts = tractor_spec(s.machine)
        whole.model = simulation_model(parts, s.terrain.ground(), s.step_s, s.plant.tyre.native)
        whole.model.opt.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_ISLAND)
        whole.data = mujoco.MjData(whole.model)
        return whole

    def seconds(self, steps: int, batched: bool = False) -> float:
        """Time of `steps` steps, in one call per step or in a single call [s]."""
        model, data, step = self.model, self.data, mujoco.mj_step
        spent = 0.0
        while steps > 0:
            count = min(steps, HELD_STEPS)
            mujoco.mj_setState(model, data, self.start, self.kind)
            began = time.process_time()
            if batched:
                step(model, data, nstep=count)
            else:
                for _ in range(count):
                    step(model, data)
            spent += time.process_time() - began
            steps -= count
        return spent

    def undisturbed(self, steps: int, count: int = 2000) -> float:
        """Tenth percentile of the time of `steps` steps: those that nothing interrupts [s]."""
        found = [self.seconds(steps) for _ in range(count)]
        return float(np.percentile(found, UNDISTURBED))


class Cost(NamedTuple):
    """Medians over the repetitions."""

    run_over_bare: float
    """A run without recording over as many calls of mj_step [-]."""
    run_over_drawn: float
    """A run over as many bare steps of a model that has all that is drawn [-]."""
    tick_over_bare: float
    """An undisturbed tick over as many undisturbed calls of mj_step [-]."""
    tick_over_drawn: float
    """An undisturbed tick over bare steps of the model that has all that is drawn [-]."""
    tick_s: float
    """An undisturbed tick [s]."""
    run_over_batched: float
    """Cost of a run without recording over that of mj_step(nstep=...) [-]."""
    recording_share: float
    """What recording adds to a run, in the run's own thread [-]."""
    recording_threads: float
    """What it adds in all threads [-]."""
    run_s: float
    """Fastest run without recording [s]."""
    bare_s: float
    """Fastest bare stepping, one call per step [s]."""
    drawn_s: float
    """Fastest bare stepping of the drawn model [s]."""


def steps_of(scenario: Scenario) -> int:
    """Physics steps of the complete run, settling included."""
    settle = round(getattr(scenario.plant, "settle_s", 0.0) / scenario.step_s)
    return (scenario.ticks - 1) * scenario.steps_per_tick + settle


def seconds_of(work: Callable[[], Any]) -> float:
    """Processor time of `work`, all threads together [s]."""
    began = time.process_time()
    work()
    return time.process_time() - began


def waited(work: Callable[[], Any]) -> float:
    """Wall time of `work` [s]."""
    began = time.perf_counter()
    work()
    return time.perf_counter() - began


def compare_costs(scenario: Scenario, repeats: int) -> Cost:
    """Alternate bare steps, a run, and a recorded run; the first round warms up and does not count."""
    bare, steps = BareModel(scenario), steps_of(scenario)
    drawn, rounds = bare.as_drawn(), []
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "run.rrd"
        for _ in range(repeats + 1):
            one_by_one, batched, whole = bare.seconds(steps), bare.seconds(steps, batched=True), drawn.seconds(steps)
            began = time.thread_time()
            plain = seconds_of(lambda: run(scenario))
            middle = time.thread_time()
            recorded = seconds_of(lambda: run(scenario, (Recording(file),)))
            thread = (time.thread_time() - middle) / (middle - began)
            rounds.append((one_by_one, batched, whole, plain, recorded, thread))
            file.unlink()
    kept, tick, in_a_tick = rounds[1:], undisturbed_tick(scenario), scenario.steps_per_tick
    return Cost(
        tick_over_bare=tick / bare.undisturbed(in_a_tick),
        tick_over_drawn=tick / drawn.undisturbed(in_a_tick),
        tick_s=tick,
        run_over_bare=median(plain / one for one, _, _, plain, _, _ in kept),
        run_over_drawn=median(plain / whole for _, _, whole, plain, _, _ in kept),
        run_over_batched=median(plain / batched for _, batched, _, plain, _, _ in kept),
        recording_share=median(thread - 1 for *_, thread in kept),
        recording_threads=median(recorded / plain - 1 for _, _, _, plain, recorded, _ in kept),
        run_s=min(plain for _, _, _, plain, _, _ in kept),
        bare_s=min(one for one, *_ in kept),
        drawn_s=min(whole for _, _, whole, *_ in kept),
    )


def undisturbed_tick(scenario: Scenario) -> float:
    """Tenth percentile of the processor time of a tick in a run: those that nothing interrupts [s]."""
    simulation, found = Simulation(scenario), []
    simulation.reset()
    while not simulation.done:
        began = time.thread_time()
        simulation.step()
        found.append(time.thread_time() - began)
    return float(np.percentile(found, UNDISTURBED))


@contextmanager
def stopwatches(scenario: Scenario) -> Iterator[dict[str, float]]:
    """Time every part of a tick while the block runs: name of the part to seconds."""
    spent: dict[str, float] = defaultdict(float)

    def timed(part: str, function: Callable[..., Any]) -> Callable[..., Any]:
        def call(*arguments: Any) -> Any:
            began = time.thread_time()
            result = function(*arguments)
            spent[part] += time.thread_time() - began
            return result

        return call

    plant = MujocoPlant if scenario.plant.kind == "mujoco" else simulate.BicyclePlant
    places: list[tuple[str, Any, str]] = [
        ("plant", plant, "advance"),
        ("sensors", type(scenario.sensors), "measure"),
        ("estimator", type(scenario.estimator), "update"),
        ("guidance and control", type(scenario.path), "at"),
        ("guidance and control", simulate.Loop, "decide"),
        ("guidance and control", SpeedLoop, "update"),
        ("guidance and control", SteeringLoop, "update"),
        ("log", stepping, "row"),
        ("log", plant, "wheels"),
        ("log", plant, "poses"),
        ("log", plant, "actuation"),
        ("log", Rows, "append"),
    ]
    with ExitStack() as stack:
        for part, owner, name in places:
            stack.enter_context(patch.object(owner, name, timed(part, getattr(owner, name))))
        yield spent


def tick_parts(scenario: Scenario) -> dict[str, float]:
    """Processor time of each part of an undisturbed tick, and of the rest of it [s]."""
    simulation, ticks = Simulation(scenario), list[dict[str, float]]()
    simulation.reset()
    with stopwatches(scenario) as spent:
        while not simulation.done:
            spent.clear()
            began = time.thread_time()
            simulation.step()
            total = time.thread_time() - began
            ticks.append({**spent, "the rest": total - sum(spent.values())})
    order = ("plant", "sensors", "estimator", "guidance and control", "log", "the rest")
    return {part: float(np.percentile([each.get(part, 0.0) for each in ticks], UNDISTURBED)) for part in order}


def rough_ground(nodes: int = GRID) -> Ground:
    """A grid of so many nodes each way, decimetres apart, with bumps of millimetres."""
    heights = np.random.default_rng(1).uniform(-0.002, 0.002, (nodes, nodes))
    return Ground(-0.05 * nodes, -0.05 * nodes, 0.1, heights)


def tyre_costs(repeats: int) -> dict[str, float]:
    """Physics steps with each tyre's kernel over as many bare steps of the same model, on a 200 x 200 grid [-]."""
    tyres = [tyre() for tyre in every(Tyre)]
    return {tyre.kind: physics_over_bare(tyre, NoImplement(), repeats) for tyre in tyres if not tyre.native}


def implement_costs(repeats: int) -> dict[str, float]:
    """Physics steps with each kind of implement, tool in the soil, over as many bare steps of the same model [-]."""
    kinds: list[Any] = [kind() for kind in every(Implement) if kind is not NoImplement]
    return {
        **{f"{kind.kind} implement": physics_over_bare(Mujoco().tyre, kind, repeats) for kind in kinds},
        "drawn implement with a tool": physics_over_bare(Mujoco().tyre, Drawn(lowered=True), repeats),
    }


def physics_over_bare(tyre: Any, implement: ImplementBase, repeats: int) -> float:
    """Physics steps of a tractor over as many bare steps of its model, on a 200 x 200 grid [-]."""
    s = load_scenario("straight_line")
    machine = s.machine._replace(implement=implement)
    plant = MujocoPlant(Mujoco(tyre=tyre), machine, rough_ground())
    plant.reset(s.path.at(0.0))
    for _ in range(20):
        plant.advance(Drive(NEUTRAL_V, 8.0))  # a slow start: it stays on the grid
    start = plant.save()
    return median(tyred_over_bare(plant, start) for _ in range(8 * repeats))


def aim_of(kind: str) -> float:
    """Aim for the physics with a kind of tyre, or of implement, over a bare step [-]."""
    tyre = members(Tyre).get(kind)
    return AIM_TYRE if tyre is None or tyre().structure().bearing == FIRM else AIM_SINKING


def tyred_over_bare(plant: MujocoPlant, start: MujocoState) -> float:
    """Twenty ticks of the plant from the state `start` over as many bare steps, each tick's from where it begins [-].

    Soil and bristles go back with the state. Held tyre forces soon throw the bare tractor over, which then costs more.
    """
    kind, rest, tyred, bare = mujoco.mjtState.mjSTATE_INTEGRATION, Drive(NEUTRAL_V, NEUTRAL_V), 0.0, 0.0
    begins = np.empty((20, mujoco.mj_stateSize(plant.model, kind)))
    plant.restore(start)
    for state in begins:
        mujoco.mj_getState(plant.model, plant.data, state, kind)
        plant.step_through(rest)
    for _ in range(5):
        plant.restore(start)
        tyred += seconds_of(lambda: [plant.step_through(rest) for _ in begins])
        for state in begins:
            mujoco.mj_setState(plant.model, plant.data, state, kind)
            bare += seconds_of(lambda: [mujoco.mj_step(plant.model, plant.data) for _ in plant.samples[0]])
    return tyred / bare


def start_up_times(repeats: int) -> dict[str, float]:
    """Least wall time of short command lines, each in its own process; the first one warms up [s]."""
    with tempfile.TemporaryDirectory() as folder:
        found = {}
        for line in START_UP:
            where = ["--out", folder] if line.startswith("run") else []
            command = [sys.executable, "-m", "agrobot_mj", *line.split(), *where]
            call = partial(subprocess.run, command, check=True, stdout=subprocess.DEVNULL)
            found[line] = min([waited(call) for _ in range(repeats + 1)][1:])
    return found


def start_up_report(times: dict[str, float]) -> str:
    """The start-up times as text."""
    return "\n".join(
        [
            "",
            "start-up [s], best of several",
            *(f"  {line:32}{times[line]:6.2f} s aim: {START_UP[line]} s" for line in times),
        ]
    )


def report(scenario: Scenario, cost: Cost, parts: dict[str, float], tyres: dict[str, float]) -> str:
    """The measurements as text."""
    steps, simulated = steps_of(scenario), scenario.ticks * simulate.TICK_S
    total = sum(parts.values())
    return "\n".join(
        [
            f"{scenario.name}, {scenario.controller.kind} on {scenario.plant.kind}: "
            f"{simulated:.0f} s simulated in {steps} steps of {scenario.step_s * 1e3:g} ms",
            "",
            f"{'closed-loop run / bare mj_step':34}{cost.run_over_bare:6.2f}   aim: at most {AIM_RATIO}",
            f"{'  or over mj_step(nstep=...)':34}{cost.run_over_batched:6.2f}",
            f"{'  or over that of the drawn model':34}{cost.run_over_drawn:6.2f}",
            f"{'  undisturbed ticks':34}{cost.tick_over_bare:6.2f}",
            f"{'  and over that of the drawn model':34}{cost.tick_over_drawn:6.2f}",
            f"{'recording adds':34}{cost.recording_share:6.1%}   aim: at most {AIM_RECORDING:.0%}",
            f"{'  in all threads':34}{cost.recording_threads:6.1%}",
            "",
            f"physics with valves and tyres on a {GRID} x {GRID} grid / bare mj_step",
            *(f"  {kind:32}{ratio:6.2f}   aim: at most {aim_of(kind)}" for kind, ratio in tyres.items()),
            "",
            f"a run takes {cost.run_s:.2f} s ({simulated / cost.run_s:.0f} times real time, aim: {AIM_REAL_TIME:.0f})",
            f"a step takes {cost.run_s / steps * 1e6:.1f} us, bare {cost.bare_s / steps * 1e6:.1f} us, "
            f"bare with all that is drawn {cost.drawn_s / steps * 1e6:.1f} us",
            "",
            "one tick of 50 ms                    us   share",
            *(f"  {part:30}{time_s * 1e6:7.0f} {time_s / total:7.1%}" for part, time_s in parts.items()),
            f"  {'sum':30}{total * 1e6:7.0f}",
        ]
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenario", default="figure_eight")
    parser.add_argument("--duration", type=float, help="simulated time [s]; the scenario's own when left out")
    parser.add_argument("--repeats", type=int, default=7)
    parser.add_argument("--start-up", action="store_true", help="measure start-up times only")
    arguments = parser.parse_args()
    overrides = {} if arguments.duration is None else {"duration_s": arguments.duration}
    scenario = load_scenario(arguments.scenario, overrides)
    if arguments.start_up:
        print(start_up_report(start_up_times(arguments.repeats)))
        return
    cost = compare_costs(scenario, arguments.repeats)
    parts = tick_parts(scenario)
    physics = tyre_costs(arguments.repeats) | implement_costs(arguments.repeats)
    print(report(scenario, cost, parts, physics))
    print(start_up_report(start_up_times(arguments.repeats)))


if __name__ == "__main__":
    main()
