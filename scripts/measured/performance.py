"""Blocks of the page docs/performance.md: computing time of a run, and its dependence on the size of the simulation."""

import os
import subprocess
import sys
import tempfile
from pathlib import Path

from bench import drive_on, in_turn, moving, physics_costs, rough_ground, run_costs, seconds_of, tick_parts
from sweeps import Part

from agrobot_mj import load_scenario
from agrobot_mj.core.markdown import markdown_table
from agrobot_mj.simulation.stepping import Simulation
from agrobot_mj.tyres import MagicFormula

NODES, LENGTHS_S, RUNS = (100, 300, 1000, 2000), (30.0, 120.0, 480.0), (1, 4, 16)
"""Numbers of terrain nodes per side, durations of a run [s], and numbers of runs in a sweep."""
SWEEP = 'base = "figure_eight"\nseeds = {n}\n[set]\n"plant.kind" = "bicycle"\n"duration_s" = 60.0\n'


def by_terrain() -> dict[float, float]:
    """Return the time of a physics step [us], by number of nodes per side of the height grid."""
    plants = {n: moving(MagicFormula(), ground=rough_ground(n)) for n in NODES}
    states = {n: plant.save() for n, plant in plants.items()}

    def drive(n: int) -> None:
        plants[n].restore(states[n])
        drive_on(plants[n], 20)

    steps = 20 * plants[NODES[0]].samples.shape[1]
    times = in_turn(*(lambda n=n: drive(n) for n in NODES))
    return {n: 1e6 * time / steps for n, time in zip(NODES, times, strict=True)}


def by_length() -> dict[float, float]:
    """Return the time of a tick [us], by duration of the run."""
    found = {}
    for length in LENGTHS_S:
        simulation = Simulation("figure_eight", {"duration_s": length, "path.turns": 4})
        simulation.reset()
        n = simulation.scenario.ticks
        found[length] = 1e6 * seconds_of(lambda s=simulation, n=n: [s.done or s.step() for _ in range(n)]) / n
    return found


def by_runs() -> dict[float, float]:
    """Return the processor time per one-minute bicycle run [s], with process start, by number of runs in a process."""
    found = {}
    for n in RUNS:
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "sweep.toml"
            file.write_text(SWEEP.format(n=n), encoding="utf-8")
            command = [sys.executable, "-m", "agrobot_mj", "sweep", str(file), "--out", f"{folder}/out"]
            before = os.times()
            subprocess.run([*command, "--jobs", "1", "--quiet"], check=True, stdout=subprocess.DEVNULL)
            after = os.times()
        used = after.children_user + after.children_system - before.children_user - before.children_system
        found[n] = used / n
    return found


def growth() -> str:
    """Return a table of computing times by size of the simulation."""
    curves = {
        "terrain nodes in each direction, per physics step": ("us", by_terrain()),
        "length of the run [s], per tick": ("us", by_length()),
        "runs of a sweep, per run of the bicycle model": ("s", by_runs()),
    }
    rows = []
    for what, (unit, curve) in curves.items():
        sizes, costs = ", ".join(f"{size:g}" for size in curve), ", ".join(f"{cost:.3g}" for cost in curve.values())
        rows.append((what, sizes, f"{costs} {unit}"))
    return markdown_table(("varied size, cost", "sizes", "cost"), rows)


REPEATS = 5  # Number of rounds of a measurement
PARTS: dict[str, Part] = {
    "aims": lambda study: {"aims": run_costs(load_scenario("figure_eight"), REPEATS)},
    "tick": lambda study: {"tick": tick_parts(load_scenario("figure_eight"))},
    "physics": lambda study: {"physics": physics_costs(REPEATS)},
    "growth": lambda study: {"growth": growth()},
}
