"""docs/performance.md: measure what a run costs, beside peers and as it grows, and write its tables and figures.

A peer whose package is not installed is named, and its last row stays in the page.
"""

import argparse
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

from bench import drive_on, in_turn, moving, physics_costs, rough_ground, run_costs, seconds_of, tick_parts
from blocks import block, page, put
from peers import PEERS

from agrobot_mj import load_scenario
from agrobot_mj.control.t2fnn import T2Fnn
from agrobot_mj.core.markdown import markdown_table
from agrobot_mj.core.signals import TICK_S
from agrobot_mj.simulation.stepping import Simulation
from agrobot_mj.tyres import MagicFormula

PAGE = page("performance")
BLOCKS = ("aims", "tick", "physics", "peers", "growth")
"""Blocks of the page."""
NODES = (100, 300, 1000, 2000)
"""Nodes of the terrain each way."""
LENGTHS_S = (30.0, 120.0, 480.0)
"""Lengths of a run [s]."""
RULES = (3, 5, 10, 20, 50)
"""Sets of each input of the network."""
RUNS = (1, 4, 16)
"""Runs of a sweep."""
SWEEP = 'base = "figure_eight"\nseeds = {n}\n[set]\n"plant.kind" = "bicycle"\n"duration_s" = 60.0\n'
Curve = dict[float, float]
"""Cost by size."""


def peers(text: str) -> str:
    """The table of peers; what cannot be measured keeps its last row."""
    old = [line.strip("| ").split(" | ") for line in block(text, "peers").splitlines()[2:]]
    rows = []
    for package, measure in PEERS.items():
        try:
            rows += [(package, *row) for row in measure()]
        except ImportError as error:
            print(f"skipped: {package} ({error})", file=sys.stderr)
            rows += [cells for cells in old if cells[0] == package]
    return markdown_table(("package", "what", "ours", "theirs", "theirs over ours"), rows)


def by_terrain() -> Curve:
    """Physics per step on a height grid of so many nodes each way [us]."""
    plants = {n: moving(MagicFormula(), ground=rough_ground(n)) for n in NODES}
    states = {n: plant.save() for n, plant in plants.items()}

    def drive(n: int) -> None:
        plants[n].restore(states[n])
        drive_on(plants[n], 20)

    steps = 20 * plants[NODES[0]].samples.shape[1]
    times = in_turn(*(lambda n=n: drive(n) for n in NODES))
    return {n: 1e6 * time / steps for n, time in zip(NODES, times, strict=True)}


def by_length() -> Curve:
    """A tick of a run of so many seconds [us]."""
    found = {}
    for length in LENGTHS_S:
        simulation = Simulation("figure_eight", {"duration_s": length, "path.turns": 4})
        simulation.reset()
        found[length] = 1e6 * seconds_of(lambda s=simulation: to_the_end(s)) / simulation.scenario.ticks
    return found


def to_the_end(simulation: Simulation) -> None:
    """Step until it is done."""
    while not simulation.done:
        simulation.step()


def by_rules() -> Curve:
    """A tick of a network with so many sets of each input, its report for the log included [us]."""

    def work(n: int) -> Callable[[], None]:
        network = T2Fnn(rules_1=n, rules_2=n)
        state = network.init(0.1, 0.1)

        def ticks() -> None:
            for _ in range(100):
                network.update_with_report(state, 0.12, 0.08, 0.05, TICK_S)

        return ticks

    return {n * n: 1e4 * time for n, time in zip(RULES, in_turn(*map(work, RULES)), strict=True)}


def by_runs() -> Curve:
    """A run of a sweep of so many runs of a minute of the bicycle, start included, in one process [s]."""
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
    """How costs grow with the size of what is simulated, as a table."""
    curves = {
        "nodes of the terrain each way, a physics step": ("us", by_terrain()),
        "length of the run [s], a tick": ("us", by_length()),
        "rules of the network, its tick": ("us", by_rules()),
        "runs of a sweep, a run of the bicycle": ("s", by_runs()),
    }
    rows = []
    for what, (unit, curve) in curves.items():
        sizes, costs = ", ".join(f"{size:g}" for size in curve), ", ".join(f"{cost:.3g}" for cost in curve.values())
        rows.append((what, sizes, f"{costs} {unit}"))
    return markdown_table(("what grows", "sizes", "cost"), rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenario", default="figure_eight")
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--only", action="append", choices=BLOCKS, help="measure this block alone; may be given again")
    given = parser.parse_args()
    scenario, text = load_scenario(given.scenario), PAGE.read_text(encoding="utf-8")
    measures: tuple[Callable[[], str], ...] = (
        lambda: run_costs(scenario, given.repeats),
        lambda: tick_parts(scenario),
        lambda: physics_costs(given.repeats),
        lambda: peers(text),
        growth,
    )
    for name, measure in zip(BLOCKS, measures, strict=True):
        text = put(text, name, measure()) if name in (given.only or BLOCKS) else text
    PAGE.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
