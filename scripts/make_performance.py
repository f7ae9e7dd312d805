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

import matplotlib as mpl
import numpy as np
from bench import (
    AIM_RATIO,
    AIM_REAL_TIME,
    AIM_RECORDING,
    Cost,
    aim_of,
    compare_costs,
    implement_costs,
    rough_ground,
    seconds_of,
    steps_of,
    tick_parts,
    tyre_costs,
)
from blocks import block, put
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from peers import PEERS, drive_on, in_turn, moving

from agrobot_mj import load_scenario
from agrobot_mj.control.t2fnn import T2Fnn
from agrobot_mj.core.markdown import markdown_table
from agrobot_mj.core.signals import TICK_S
from agrobot_mj.scenario.schema import Scenario
from agrobot_mj.simulation.stepping import Simulation
from agrobot_mj.studies.style import STYLE
from agrobot_mj.tyres import MagicFormula

ROOT = Path(__file__).parent.parent
PAGE = ROOT / "docs" / "performance.md"
TICK, GROWTH = (ROOT / "docs" / "images" / f"performance_{name}.png" for name in ("tick", "growth"))
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


def aims(scenario: Scenario, cost: Cost) -> str:
    """The project's aims and what is measured."""
    simulated, us = scenario.ticks * TICK_S, 1e6 / steps_of(scenario)
    own, whole = "bare `mj_step` of the same model", "of the model with all that is drawn"
    rows = {
        f"closed loop without recording over {own}": (f"{cost.run_over_bare:.2f}", f"at most {AIM_RATIO}"),
        f"the same over that {whole}": (f"{cost.run_over_drawn:.2f}", ""),
        f"an undisturbed tick over as many undisturbed steps, {own}": (f"{cost.tick_over_bare:.2f}", ""),
        f"the same over that {whole}, undisturbed": (f"{cost.tick_over_drawn:.2f}", ""),
        "recording adds, in the run's own thread": (f"{cost.recording_share:.0%}", f"at most {AIM_RECORDING:.0%}"),
        "recording adds, in all threads": (f"{cost.recording_threads:.0%}", ""),
        "simulated over processor time, the fastest run": (
            f"{simulated / cost.run_s:.0f}",
            f"at least {AIM_REAL_TIME:.0f}",
        ),
        "simulated over processor time, undisturbed ticks": (f"{TICK_S / cost.tick_s:.0f}", ""),
        "a physics step in the run, all included": (f"{cost.run_s * us:.1f} us", ""),
        own: (f"{cost.bare_s * us:.1f} us", ""),
        f"the same {whole}": (f"{cost.drawn_s * us:.1f} us", ""),
    }
    return markdown_table(("what", "measured", "aim"), [(what, *found) for what, found in rows.items()])


def parts(found: dict[str, float]) -> str:
    """What a tick of 50 ms consists of."""
    total = sum(found.values())
    rows = [(part, f"{1e6 * time:.0f}", f"{time / total:.0%}") for part, time in found.items()]
    return markdown_table(("part of a tick", "us", "share"), [*rows, ("sum", f"{1e6 * total:.0f}", "")])


def physics(ratios: dict[str, float]) -> str:
    """Physics with each tyre and implement over bare steps."""
    rows = [(f"`{kind}`", f"{ratio:.2f}", aim_of(kind)) for kind, ratio in ratios.items()]
    return markdown_table(("tyre, or implement on the default tyre", "over bare `mj_step`", "aim: at most"), rows)


def peers(text: str) -> str:
    """The table of peers; what cannot be measured keeps its last row."""
    old = [line.strip("| ").split(" | ") for line in block(text, "peers").splitlines()[2:]]
    rows = []
    for package, measure in PEERS.items():
        try:
            rows += [(package, row.what, row.ours, row.theirs, row.ratio) for row in measure()]
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
                network.update(state, 0.12, 0.08, 0.05, TICK_S)
                network.report(state)

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


def growth(curves: dict[str, tuple[str, Curve]]) -> str:
    """The curves as a table."""
    rows = []
    for what, (unit, curve) in curves.items():
        sizes, costs = ", ".join(f"{size:g}" for size in curve), ", ".join(f"{cost:.3g}" for cost in curve.values())
        rows.append((what, sizes, f"{costs} {unit}"))
    return markdown_table(("what grows", "sizes", "cost"), rows)


def draw_tick(found: dict[str, float]) -> None:
    """The parts of a tick."""
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(3.5, 2.0), layout="constrained")
        FigureCanvasAgg(figure)
        axes = figure.subplots()
        axes.barh(list(found)[::-1], [1e6 * time for time in found.values()][::-1], color="#0072B2", height=0.6)
        axes.set_xlabel("undisturbed tick [us]")
        axes.grid(axis="y", visible=False)
        figure.savefig(TICK, dpi=160)


def draw_growth(curves: dict[str, tuple[str, Curve]]) -> None:
    """How the costs grow, relative to the smallest size."""
    colours, markers = ("#D55E00", "#0072B2", "#009E73", "#CC79A7"), "os^D"
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(3.5, 3.2), layout="constrained")
        FigureCanvasAgg(figure)
        axes = figure.subplots()
        for colour, marker, (what, (_, curve)) in zip(colours, markers, curves.items(), strict=True):
            sizes, costs = np.array(list(curve)), np.array(list(curve.values()))
            axes.loglog(sizes / sizes[0], costs / costs[0], marker=marker, ms=3, lw=1.2, color=colour, label=what)
        axes.set_xlabel("size over the smallest")
        axes.set_ylabel("cost over that of the smallest")
        axes.set_ylim(0.1, 10)
        figure.legend(loc="outside upper left")
        figure.savefig(GROWTH, dpi=160)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenario", default="figure_eight")
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--only", choices=["run", "physics", "peers", "growth"], help="measure one part of the page")
    arguments = parser.parse_args()
    scenario, repeats, only = load_scenario(arguments.scenario), arguments.repeats, arguments.only
    text = PAGE.read_text(encoding="utf-8")
    if only in (None, "run"):
        text = put(text, "aims", aims(scenario, compare_costs(scenario, repeats)))
        text = put(text, "tick", parts(found := tick_parts(scenario)))
        draw_tick(found)
    if only in (None, "physics"):
        text = put(text, "physics", physics(tyre_costs(repeats) | implement_costs(repeats)))
    if only in (None, "peers"):
        text = put(text, "peers", peers(text))
    if only in (None, "growth"):
        curves = {
            "nodes of the terrain each way, a physics step": ("us", by_terrain()),
            "length of the run [s], a tick": ("us", by_length()),
            "rules of the network, its tick": ("us", by_rules()),
            "runs of a sweep, a run of the bicycle": ("s", by_runs()),
        }
        text = put(text, "growth", growth(curves))
        draw_growth(curves)
    PAGE.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
