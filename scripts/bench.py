"""Benchmark of computing times: run (relative to bare MuJoCo), recording, parts of a tick, and start-up.

The benchmark runs in one process with compiled code in memory. The compared functions run alternately, and a ratio is
the median of the ratios of successive runs, so that the load of the machine affects both functions. Times are processor
times of all threads, except start-up times. Only ratios can be compared between machines.
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
from pathlib import Path
from statistics import median
from typing import Any
from unittest.mock import patch

import mujoco
import numpy as np

from agrobot_mj import load_scenario, run
from agrobot_mj.core.markdown import markdown_table
from agrobot_mj.core.signals import TICK_S, Drive
from agrobot_mj.core.spec import every
from agrobot_mj.machine.hydraulics import NEUTRAL_V
from agrobot_mj.machine.implements import Drawn, Implement, ImplementBase, NoImplement
from agrobot_mj.plants import Mujoco, MujocoPlant
from agrobot_mj.plants.mujoco.c_api import INSTALLED, clock
from agrobot_mj.plants.mujoco.model import simulation_model, tractor_spec
from agrobot_mj.plants.mujoco.saving import MujocoState
from agrobot_mj.recording import Recording
from agrobot_mj.scenario.schema import Scenario
from agrobot_mj.simulation.log import Rows
from agrobot_mj.simulation.loop import Loop
from agrobot_mj.simulation.stepping import Simulation
from agrobot_mj.terrain import Ground
from agrobot_mj.tyres import Tyre
from agrobot_mj.tyres.bearing import FIRM

AIM_RATIO, AIM_RECOMMENDED_RATIO, AIM_RECORDING = 1.35, 2.0, 0.05
"""Target computing times [-]: default and recommended stack divided by bare steps, and recording divided by the run."""
AIM_REAL_TIME, AIM_FAST, AIM_RECOMMENDED = 250.0, 600.0, 450.0
"""Target ratios of simulated time to processor time [-]: standard steps, `physics = "fast"`, and recommended stack."""
AIM_INTERPRETED = {"standard": 220, "fast": 420}
"""Targets for the real-time factor with a guidance law in Python, by physics."""
AIM_TYRE, AIM_SINKING, GRID = 1.3, 1.6, 200
"""Target times of physics steps with tyres on firm and on yielding soil, divided by bare steps [-], and number of nodes
per side of the height grid."""
START_UP = {"--version": 0.4, "--help": 0.4, "list": 0.4, "run circle --set duration_s=1": 1.5}
"""Targets of the wall time of short commands [s], by command line."""
PARTS = {
    "plant": (Loop, "advance"),
    "sensors and estimator": (Loop, "sense"),
    "guidance and supervisor": (Loop, "decide"),
    "low-level loops": (Loop, "act"),
    "log": (Rows, "append"),
}
"""Class and name of the method that performs each timed part of a tick, by name of the part."""
RECOMMENDED = {
    "guidance.kind": "lqr",
    "estimator.kind": "ekf_full",
    "sensors.imu.enabled": True,
    "sensors.gyro.enabled": True,
    "sensors.wheel_speed.enabled": True,
    "physics": "fast",
}
"""Scenario overrides for the recommended stack: LQR, `ekf_full`, and large physics steps."""
INTERPRETED = {"guidance.kind": "pure_pursuit"}  # Overrides for a guidance law in Python
UNDISTURBED = 10  # Percentile of the tick times that counts as undisturbed by other processes [%]
HELD_STEPS, MOVING_S = 500, 12.0
"""Number of steps before the bare model returns to its start state, and time of this state in a run [s]."""
NO_IMPLEMENT, ROUNDS = NoImplement(), 15  # Default implement, and number of rounds of a measurement [-]


class BareModel:
    """MuJoCo model of a moving tractor, stepped without the simulator and with constant tyre forces."""

    def __init__(self, scenario: Scenario) -> None:
        loop = Loop(scenario)
        if not isinstance(loop.plant, MujocoPlant):
            raise TypeError("the bare step is that of a MuJoCo plant")
        for _ in range(round(MOVING_S / TICK_S)):
            loop.advance(loop.tick().drive)
        self.scenario, self.model, self.data = scenario, loop.plant.model, loop.plant.data
        self.kind = mujoco.mjtState.mjSTATE_INTEGRATION
        self.start = np.empty(mujoco.mj_stateSize(self.model, self.kind))
        mujoco.mj_getState(self.model, self.data, self.start, self.kind)

    def as_drawn(self) -> "BareModel":
        """Return a copy of the model with all visual geoms and all default features of MuJoCo."""
        s, whole = self.scenario, copy(self)
        if not isinstance(s.implement, NoImplement):
            raise TypeError("the drawn model is that of a tractor without an implement")
        parts = tractor_spec(s.vehicle)
        whole.model = simulation_model(parts, s.terrain.ground(), s.step_s, s.plant.tyre.native)
        whole.model.opt.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_ISLAND)
        whole.data = mujoco.MjData(whole.model)
        return whole

    def seconds(self, steps: int) -> float:
        """Return the processor time of `steps` physics steps [s], with one Python call per step."""
        model, data, step = self.model, self.data, mujoco.mj_step
        spent = 0.0
        while steps > 0:
            count = min(steps, HELD_STEPS)
            mujoco.mj_setState(model, data, self.start, self.kind)
            clock.value = INSTALLED
            began = time.process_time()
            for _ in range(count):
                step(model, data)
            spent += time.process_time() - began
            clock.value = None
            steps -= count
        return spent

    def undisturbed(self, steps: int, count: int = 2000) -> float:
        """Return the processor time of `steps` physics steps [s], as tenth percentile of `count` measurements, to
        exclude disturbances by other processes."""
        found = [self.seconds(steps) for _ in range(count)]
        return float(np.percentile(found, UNDISTURBED))


def steps_of(scenario: Scenario) -> int:
    """Return the number of physics steps in a run, including settling."""
    settle = round(getattr(scenario.plant, "settle_s", 0.0) / scenario.step_s)
    return (scenario.ticks - 1) * scenario.steps_per_tick + settle


def seconds_of(work: Callable[[], Any]) -> float:
    """Call a function and return the processor time of the call, summed over all threads [s]."""
    began = time.process_time()
    work()
    return time.process_time() - began


def in_turn(*works: Callable[[], Any]) -> tuple[float, ...]:
    """Call functions alternately, and return the median processor time of each function [s]. The first round is
    discarded."""
    rounds = [[seconds_of(work) for work in works] for _ in range(ROUNDS + 1)][1:]
    return tuple(median(column) for column in zip(*rounds, strict=True))


def run_costs(scenario: Scenario, repeats: int) -> str:
    """Return a table of computing times with targets: closed loop and recording, relative to bare steps.

    Measurements of bare steps, run and recorded run alternate. The first round is discarded.
    """
    bare, steps, in_a_tick = BareModel(scenario), steps_of(scenario), scenario.steps_per_tick
    drawn, run_s, rounds = bare.as_drawn(), scenario.ticks * TICK_S, []
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "run.rrd"
        for _ in range(repeats + 1):
            one_by_one, whole = bare.seconds(steps), drawn.seconds(steps)
            began = time.thread_time()
            plain = seconds_of(lambda: run(scenario))
            middle = time.thread_time()
            recorded = seconds_of(lambda: run(scenario, (Recording(file),)))
            thread = (time.thread_time() - middle) / (middle - began)
            rounds.append((one_by_one, whole, plain, recorded, thread))
            file.unlink()
    bares, wholes, plains, recordings, threads = (np.array(column) for column in zip(*rounds[1:], strict=True))
    tick, fastest, us = undisturbed_tick(scenario), plains.min(), 1e6 / steps
    fast, step = undisturbed_tick(scenario.changed({"physics": "fast"})), bare.undisturbed(in_a_tick) / in_a_tick
    recommended = scenario.changed(RECOMMENDED)
    large = undisturbed_tick(recommended)
    large_steps = BareModel(recommended).undisturbed(recommended.steps_per_tick)
    laws = {k: scenario.changed({**INTERPRETED, "physics": k}) for k in AIM_INTERPRETED}
    factor = "real-time factor, undisturbed ticks"
    interpreted = [
        (f'{factor} with `physics = "{k}"`', undisturbed_tick(law), AIM_INTERPRETED[k]) for k, law in laws.items()
    ]
    own, all_of = "bare `mj_step` of the same model", "of the model with all visual geoms"
    rows = [
        (f"closed loop, no recording, divided by {own}", f"{np.median(plains / bares):.2f}", f"at most {AIM_RATIO}"),
        (f"closed loop, no recording, divided by `mj_step` {all_of}", f"{np.median(plains / wholes):.2f}"),
        (f"undisturbed tick, divided by its undisturbed steps, {own}", f"{tick / (in_a_tick * step):.2f}"),
        (f"undisturbed tick, divided by undisturbed steps {all_of}", f"{tick / drawn.undisturbed(in_a_tick):.2f}"),
        (
            "undisturbed tick of the recommended stack, divided by its bare 5 ms steps",
            f"{large / large_steps:.2f}",
            f"at most {AIM_RECOMMENDED_RATIO}",
        ),
        ("time added by recording, thread of the run", f"{np.median(threads) - 1:.0%}", f"at most {AIM_RECORDING:.0%}"),
        ("time added by recording, all threads", f"{np.median(recordings / plains) - 1:.0%}"),
        (
            "real-time factor (simulated divided by processor time), fastest run",
            f"{run_s / fastest:.0f}",
            f"at least {AIM_REAL_TIME:.0f}",
        ),
        (factor, f"{TICK_S / tick:.0f}"),
        (
            f'{factor} with `physics = "fast"`',
            f"{TICK_S / fast:.0f}",
            f"at least {AIM_FAST:.0f}",
        ),
        (
            f"{factor} of the recommended stack",
            f"{TICK_S / large:.0f}",
            f"at least {AIM_RECOMMENDED:.0f}",
        ),
        *((f"{text} and a law in Python", f"{TICK_S / t:.0f}", f"at least {aim}") for text, t, aim in interpreted),
        ("complete physics step in the run", f"{fastest * us:.1f} us"),
        (own, f"{bares.min() * us:.1f} us"),
        (f"`mj_step` {all_of}", f"{wholes.min() * us:.1f} us"),
    ]
    return markdown_table(("quantity", "measured", "target"), [(*row, "")[:3] for row in rows])


def undisturbed_tick(scenario: Scenario) -> float:
    """Return the processor time of a tick [s], as tenth percentile over the episodes (groups of ticks) of a run, to
    exclude disturbances by other processes."""
    simulation, found = Simulation(scenario), list[float]()
    simulation.reset()
    while not simulation.done:
        before, began = simulation.rows.filled, time.thread_time()
        simulation.advance()
        found.append((time.thread_time() - began) / (simulation.rows.filled - before))
    return float(np.percentile(found, UNDISTURBED))


@contextmanager
def stopwatches() -> Iterator[dict[str, float]]:
    """Measure the parts of the ticks inside the `with` block. Yield a dictionary with the processor time of each part
    [s]."""
    spent: dict[str, float] = defaultdict(float)

    def timed(part: str, function: Callable[..., Any]) -> Callable[..., Any]:
        def call(*arguments: Any) -> Any:
            began = time.thread_time()
            result = function(*arguments)
            spent[part] += time.thread_time() - began
            return result

        return call

    with ExitStack() as stack:
        for part, (owner, name) in PARTS.items():
            stack.enter_context(patch.object(owner, name, timed(part, getattr(owner, name))))
        yield spent


def tick_parts(scenario: Scenario) -> str:
    """Return a table of the processor time of each part of a tick, without disturbances. The ticks are simulated
    singly, not in episodes."""
    simulation, ticks = Simulation(scenario), list[dict[str, float]]()
    simulation.reset()
    with stopwatches() as spent:
        while not simulation.done:
            spent.clear()
            began = time.thread_time()
            simulation.step()
            total = time.thread_time() - began
            ticks.append({**spent, "other": total - sum(spent.values())})
    order = (*PARTS, "other")
    found = {part: 1e6 * np.percentile([each.get(part, 0.0) for each in ticks], UNDISTURBED) for part in order}
    whole = sum(found.values())
    rows = [(part, f"{us:.0f}", f"{us / whole:.0%}") for part, us in found.items()]
    return markdown_table(("part of a tick", "us", "fraction"), [*rows, ("sum", f"{whole:.0f}", "")])


def rough_ground(nodes: int = GRID) -> Ground:
    """Return a square height grid with `nodes` per side, a node spacing of 0.1 m and random heights within 2 mm."""
    heights = np.random.default_rng(1).uniform(-0.002, 0.002, (nodes, nodes))
    return Ground(-0.05 * nodes, -0.05 * nodes, 0.1, heights)


def moving(
    tyre: Any, ground: Ground | None = None, implement: ImplementBase = NO_IMPLEMENT, settle_s: float = 3.0
) -> MujocoPlant:
    """Return a slowly moving tractor that stays on `ground` (default: rough ground) during the measurement."""
    s = load_scenario("straight_line")
    machine = s.vehicle._replace(implement=implement)
    plant = MujocoPlant(Mujoco(tyre=tyre, settle_s=settle_s), machine, ground or rough_ground())
    plant.reset(s.path.at(0.0))
    for _ in range(20):
        plant.advance(Drive(NEUTRAL_V, 8.0))
    return plant


def drive_on(plant: MujocoPlant, ticks: int) -> None:
    """Advance a plant by `ticks` ticks with both valves in neutral."""
    for _ in range(ticks):
        plant.step_through(Drive(NEUTRAL_V, NEUTRAL_V))


def physics_costs(repeats: int) -> str:
    """Return a table of the computing time of physics steps with each tyre law and implement, divided by bare steps of
    the same model."""
    tyres = [tyre() for tyre in every(Tyre) if not tyre().native]
    aims = {tyre.kind: AIM_TYRE if tyre.structure().bearing == FIRM else AIM_SINKING for tyre in tyres}
    found = {tyre.kind: physics_over_bare(tyre, NO_IMPLEMENT, repeats) for tyre in tyres}
    kinds = {f"{kind().kind} implement": kind() for kind in every(Implement) if kind is not NoImplement}
    for name, implement in {**kinds, "drawn implement with a tool": Drawn(lowered=True)}.items():
        found[name] = physics_over_bare(Mujoco().tyre, implement, repeats)
    rows = [(f"`{name}`", f"{ratio:.2f}", aims.get(name, AIM_TYRE)) for name, ratio in found.items()]
    return markdown_table(
        ("tyre, or implement on the default tyre", "divided by bare `mj_step`", "target: at most"), rows
    )


def physics_over_bare(tyre: Any, implement: ImplementBase, repeats: int) -> float:
    """Return the time of physics steps with a tyre and an implement, divided by the time of bare steps [-], on a grid
    of 200 x 200 nodes."""
    plant = moving(tyre, implement=implement)
    start = plant.save()
    return median(tyred_over_bare(plant, start) for _ in range(8 * repeats))


def tyred_over_bare(plant: MujocoPlant, start: MujocoState) -> float:
    """Return the time of 20 plant ticks from the state `start` divided by the time of as many bare steps [-].

    Each bare tick starts from a state of the plant. Otherwise the bare tractor would tip over and slow down the steps.
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
        clock.value = INSTALLED
        for state in begins:
            mujoco.mj_setState(plant.model, plant.data, state, kind)
            bare += seconds_of(lambda: [mujoco.mj_step(plant.model, plant.data) for _ in plant.samples[0]])
        clock.value = None
    return tyred / bare


def start_up_times(repeats: int) -> str:
    """Return a table of the minimum wall time of short commands in separate processes, without the first call."""
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for line, aim in START_UP.items():
            where, waits = ["--out", folder] if line.startswith("run") else [], []
            for _ in range(repeats + 1):
                began = time.perf_counter()
                command = [sys.executable, "-m", "agrobot_mj", *line.split(), *where]
                subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
                waits.append(time.perf_counter() - began)
            rows.append((f"`{line}`", f"{min(waits[1:]):.2f}", aim))
    return markdown_table(("command", "least time [s]", "aim: at most"), rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenario", default="figure_eight")
    parser.add_argument("--repeats", type=int, default=7)
    parser.add_argument("--start-up", action="store_true", help="measure start-up times only")
    given = parser.parse_args()
    if not given.start_up:
        scenario = load_scenario(given.scenario)
        print(run_costs(scenario, given.repeats), tick_parts(scenario), physics_costs(given.repeats), sep="\n\n")
    print("", start_up_times(given.repeats), sep="\n")


if __name__ == "__main__":
    main()
