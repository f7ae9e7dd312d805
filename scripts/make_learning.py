"""docs/learning.md's numbers and figures: what the printed law does, and learners against laws that do not learn.

Parts: the sweep `learning_printed`, `figures`, and a surface each: the sweep `learning`, changed in places. Those on
MuJoCo, which take hours, are run only where they are named with `--part`.
"""

from collections.abc import Sequence
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from estimates import Row, by_seed, difference, field
from matplotlib import rc_context
from matplotlib.figure import Figure
from sweeps import KeptRun, Study, shipped, variants

from agrobot_mj import load_scenario, run
from agrobot_mj.control.path_network import PathInput, PathNetworkState
from agrobot_mj.control.t2fnn_laws import sgn
from agrobot_mj.core.markdown import markdown_table
from agrobot_mj.core.signals import TICK_S
from agrobot_mj.metrics.base import RunView
from agrobot_mj.metrics.success import failures, has_errors
from agrobot_mj.simulation.log import Log
from agrobot_mj.studies.statistics import bootstrap_interval
from agrobot_mj.studies.style import STYLE, save

GRID = shipped("learning")
BASELINES = ("PI + feed-forward", "LQR", "nmpc")
"""The best laws that do not learn, with the gains of the search for all laws."""
PAIRS = [*product(("learner + P", "learner + LQR"), BASELINES), ("learner + P", "learner + P, type 1")]
"""Laws that are compared seed by seed."""
MUJOCO = {"plant.kind": "mujoco", "plant.tyre.kind": "magic_formula"}
HEADING = {"estimator.kind": "ekf_full", "sensors.gyro.enabled": True, "sensors.wheel_speed.enabled": True}
# The supervisor takes the feed-forward's jump from lock to lock for a fault and stops: off for a fair comparison.
SWATHS = {**GRID["set"], "path.length_m": 40, "path.count": 5, "supervisor.enabled": False}
SURFACES: dict[str, dict[str, Any]] = {
    "figure eight": {},
    "swaths": {"base": "one_hectare", "set": SWATHS},
    "figure eight on MuJoCo": {"set": MUJOCO},
    "figure eight on MuJoCo with a heading": {"set": {**MUJOCO, **HEADING}},
}
"""What differs from the sweep, by the name of the page's block."""
TURNS, PASSES = {"xte_1": "turn 1", "xte_2": "turn 2"}, {"pass_rms": "passes", "headland_rms": "headlands"}
"""Measures [m] and their names."""


def denominator(log: Log | KeptRun) -> np.ndarray:
    """f (W_lower - W_upper), the denominator of q's law, at every tick [rad]."""
    network = log.scenario.controller.network
    rules = [f"{i}_{j}" for i in range(network.rules_1) for j in range(network.rules_2)]
    parts = [log.column(f"f_{k}") * (log.column(f"w_lower_{k}") - log.column(f"w_upper_{k}")) for k in rules]
    return np.sum(parts, axis=0)


def effective_rate(log: Log | KeptRun, rows: np.ndarray) -> float:
    """Least-squares rate of tau_n over -alpha sgn(tau_c) in these rows [-]."""
    network = log.scenario.controller.network
    sign = np.array([sgn(x, network.delta_s) for x in log.column("tau_c")])[:-1]
    rate = -np.diff(log.column("tau_n")) / TICK_S
    some = rows[:-1]
    return float((rate * sign)[some].sum() / (sign[some] ** 2).sum() / network.alpha)


def printed_numbers(run: KeptRun) -> dict[str, list[Any]]:
    """A network by turn: its denominator's median, rate, resting q, and how often its condition is broken."""
    if "fnn" not in run.scenario.controller.kind:
        return {}
    q, size, network = run.column("q"), np.abs(denominator(run)), run.scenario.controller.network
    tau_rate = np.abs(np.diff(run.column("tau_c") - run.column("tau_n"))) / TICK_S
    ticks = np.arange(len(q))
    turns = [((ticks >= rows.start) & (ticks < rows.stop))[:-1] for rows in RunView(run).turns]
    return {
        "den": [float(np.median(size[:-1][rows])) for rows in turns],
        "eff": [effective_rate(run, np.append(rows, False)) for rows in turns],
        "q_rests": [100 * float(np.mean(np.diff(q)[rows] == 0)) for rows in turns],
        "alpha_broken": [100 * float(np.mean(tau_rate[rows] >= network.alpha)) for rows in turns],
    }


def compared_numbers(row: Row, run: KeptRun) -> Row:
    """A run's row with its errors per turn, or on passes and headlands [m], and the travel of the steering [deg]."""
    path, found = run.scenario.path, {f"xte_{turn['turn']}": turn["xte_rms"] for turn in row["per_turn"]}
    found["travel_deg"] = float(np.degrees(np.abs(np.diff(run.column("steer"))).sum()))
    if hasattr(path, "passes_s"):
        t, offset = run.column("t"), RunView(run).beside.offset
        on_pass = np.any([(t > start) & (t <= end) for start, end in path.passes_s], axis=0)
        found["pass_rms"] = float(np.sqrt(np.mean(offset[on_pass] ** 2)))
        found["headland_rms"] = float(np.sqrt(np.mean(offset[~on_pass] ** 2)))
    return {**row, **found}


def comparison_table(rows: Sequence[Row], measures: dict[str, str]) -> str:
    """Mean error of each law, and the paired differences of the learners from each baseline, in cm."""
    laws = {law: [row for row in rows if row["variant"] == law] for law in variants("learning")}
    heads = [f"{name} [cm]" for name in measures.values()]
    lines = [(law, *_means(some, list(measures))) for law, some in laws.items() if some]
    means = markdown_table(("law", "seeds", *heads, "steering travel [deg]"), lines, 1)
    pairs = []
    for law, base in PAIRS:
        found = [
            difference(*(by_seed(laws[name], field(key)) for name in (law, base)), bootstrap_interval)
            for key in measures
        ]
        if found[0].n > 1:
            seeds = f"{found[0].n} of {found[0].n + found[0].failed}" if found[0].failed else found[0].n
            pairs.append((f"{law} less {base}", seeds, *(each._replace(failed=0).text(2, 100, "+") for each in found)))
    return f"{means}\n\n{markdown_table(('paired difference', 'seeds', *heads), pairs, 1)}"


def _means(every: Sequence[Row], measures: Sequence[str]) -> list[str]:
    """How many runs of a law count, their mean errors [cm] and travel [deg]."""
    mine = [row for row in every if has_errors(row)]
    if not mine:
        return [f"0 (failed {failures(every)})", *["-"] * (len(measures) + 1)]
    seeds = str(len(mine)) if len(mine) == len(every) else f"{len(mine)} (failed {failures(every)})"
    means = [f"{100 * np.mean([row[key] for row in mine]):.2f}" for key in measures]
    return [seeds, *means, f"{np.mean([row['travel_deg'] for row in mine]):.0f}"]


def printed_tables(rows: Sequence[tuple[Row, dict[str, list[Any]]]]) -> dict[str, str]:
    """Lateral mean square error by turn, its gain and the network's own numbers; and turn by turn over eight turns."""
    lines, turns = [], ""
    for row, own in rows:
        first, second, *more = (turn["lateral_mse"] for turn in row["per_turn"])
        if more:
            turns = turns_table([first, second, *more], own)
            continue
        cells = ["-"] * 4
        if own and "pd_t1fnn" not in row["variant"]:
            texts = (("eff", ".2f", ""), ("den", ".4f", ""), ("q_rests", ".0f", " %"), ("alpha_broken", ".0f", " %"))
            cells = [f"{own[key][0]:{digits}}, {own[key][1]:{digits}}{unit}" for key, digits, unit in texts]
        lines.append((row["variant"], f"{first:.4f}", f"{second:.4f}", f"{second / first:.2f}", *cells))
    heads = ("run", "turn 1 [m2]", "turn 2 [m2]", "turn 2 / 1", "rate / alpha", "denominator [rad]", "q rests")
    return {"printed": markdown_table((*heads, "condition broken"), lines, 1), "turns": turns}


def turns_table(errors: Sequence[float], own: dict[str, list[Any]]) -> str:
    """Turn by turn: the network's denominator, resting q and rate, and its error."""
    columns = zip(own["den"], own["q_rests"], own["eff"], errors, strict=True)
    lines = [
        (k, f"{d:.3f}", f"{rests:.0f}", f"{rate:.2f}", f"{mse:.4f}")
        for k, (d, rests, rate, mse) in enumerate(columns, 1)
    ]
    heads = ("turn", "denominator, median [rad]", "q rests [%]", "rate / alpha", "lateral MSE [m2]")
    return markdown_table(heads, lines, 1)


def draw_printed(images: Path) -> None:
    """q, its law's denominator and tau_n over four turns."""
    log = run(load_scenario("figure_eight", {**GRID["set"], "path.turns": 4}))
    t = log.column("t")
    with rc_context(STYLE):
        figure = Figure(figsize=(7.0, 4.2), layout="constrained")
        axes = figure.subplots(3, 1, sharex=True)
        axes[0].plot(t, log.column("q"), color="#0072B2")
        axes[0].set_ylabel("q [-]")
        axes[1].plot(t, denominator(log), color="#D55E00")
        axes[1].set_ylabel("denominator [rad]")
        axes[2].plot(t, log.column("tau_c"), color="#999999", label="tau_c")
        axes[2].plot(t, log.column("tau_n"), color="#009E73", label="tau_n")
        axes[2].set_ylabel("steering [rad]")
        axes[2].set_xlabel("time [s]")
        axes[2].legend(loc="upper right", ncols=2)
        save(figure, images / "learning_printed.png")


def draw_map(images: Path) -> None:
    """The learnt map after each turn of the figure eight, and after the swaths, beside atan(L kappa)."""
    curvature = np.linspace(-0.4, 0.4, 161)
    with rc_context(STYLE):
        figure = Figure(figsize=(7.0, 2.8), layout="constrained")
        for axis, surface in zip(figure.subplots(1, 2, sharey=True), ("figure eight", "swaths"), strict=True):
            changed = GRID | SURFACES[surface]
            log = run(load_scenario(changed["base"], {**changed["set"], **variants("learning")["learner + P"]}))
            network, rules = log.scenario.guidance.network, [c for c in log.rows.columns if c.startswith("map_")]
            f = np.array([log.column(rule) for rule in rules])
            for label, row in zip(("halfway", "at the end"), (f.shape[1] // 2, -1), strict=True):
                state = PathNetworkState(f[:, row], f[:, row])
                angle = [network.firing(PathInput(kappa, 1.2)) @ state.f for kappa in curvature]
                axis.plot(curvature, np.degrees(angle), label=f"learnt, {label}")
            axis.plot(
                curvature,
                np.degrees(np.arctan(log.scenario.tractor.wheelbase_m * curvature)),
                "k:",
                label="atan(L kappa)",
            )
            axis.set_title(surface)
            axis.set_xlabel("curvature ahead [1/m]")
            axis.legend(loc="upper left")
        figure.axes[0].set_ylabel("steering angle [deg]")
        save(figure, images / "learning_map.png")


def main(arguments: list[str] | None = None) -> None:
    study = Study("learning", __doc__, arguments)
    blocks = {}
    for surface, changes in SURFACES.items():
        name = surface.replace(" ", "_")
        due = "MuJoCo" not in surface or (study.parts and name in study.parts)
        rows = study.rows(name, "learning", **changes) if due else study.there(name)
        if rows:
            numbers = [compared_numbers(row, study.kept(name, row)) if has_errors(row) else row for row in rows]
            blocks[surface] = comparison_table(numbers, PASSES if surface == "swaths" else TURNS)
    rows = study.rows("learning_printed")
    runs = [(row, study.kept("learning_printed", row)) for row in rows]
    if runs:
        blocks |= printed_tables(
            [(row, printed_numbers(run) if "fnn" in run.scenario.controller.kind else {}) for row, run in runs]
        )
    study.write(blocks)
    if study.only_draw or study.runs_part("figures"):
        draw_printed(study.images)
        draw_map(study.images)


if __name__ == "__main__":
    main()
