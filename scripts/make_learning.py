"""docs/learning.md's numbers and figures: what the printed law does, and learners against laws that do not learn.

Runs leave one line each in runs/learning/*.jsonl and are not repeated: an interrupted study goes on where it stopped,
and several processes can share it by seeds (`--part comparison --seeds 1:8`). `--part publish` writes the page.
"""

import argparse
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from blocks import put
from matplotlib import rc_context
from matplotlib.figure import Figure

from agrobot_mj import load_scenario, run
from agrobot_mj.control.path_network import PathInput, PathNetworkState
from agrobot_mj.control.t2fnn_laws import sgn
from agrobot_mj.core.signals import TICK_S
from agrobot_mj.metrics.base import RunView
from agrobot_mj.metrics.success import failures, has_errors
from agrobot_mj.simulation.log import Log
from agrobot_mj.studies.style import STYLE, save

ROOT = Path(__file__).parent.parent
RUNS, PAGE, IMAGES = ROOT / "runs" / "learning", ROOT / "docs" / "learning.md", ROOT / "docs" / "images"
BICYCLE = {"plant.kind": "bicycle"}
MUJOCO = {"plant.kind": "mujoco", "plant.tyre.kind": "magic_formula"}
HEADING = {"estimator.kind": "ekf_full", "sensors.gyro.enabled": True, "sensors.wheel_speed.enabled": True}
P = {"controller.kind": "pd"}
LEARNER = {"guidance.kind": "learned_feedforward", **P}
LAWS: dict[str, dict[str, Any]] = {
    "PI": {"controller.kind": "pi"},
    "P + feed-forward": {**P, "guidance.kind": "feedforward"},
    "PI + feed-forward": {"controller.kind": "pi", "guidance.kind": "feedforward"},
    "LQR": {"guidance.kind": "lqr"},
    "nmpc": {"guidance.kind": "nmpc"},
    "learner + P": LEARNER,
    "learner + LQR": {**LEARNER, "guidance.inner.kind": "lqr"},
    "learner + P, type 1": {**LEARNER, "guidance.network.uncertainty": 0.0},
}
BASELINES = ("PI + feed-forward", "LQR", "nmpc")
"""The best laws that do not learn, with the gains of the search for all laws."""
SURFACES: dict[str, tuple[str, dict[str, Any]]] = {
    "figure eight": ("figure_eight", BICYCLE),
    # The supervisor takes the feed-forward's jump from lock to lock for a fault and stops: off for a fair comparison.
    "swaths": ("one_hectare", {**BICYCLE, "path.length_m": 40, "path.count": 5, "supervisor.enabled": False}),
    "figure eight on MuJoCo": ("figure_eight", MUJOCO),
    "figure eight on MuJoCo with a heading": ("figure_eight", {**MUJOCO, **HEADING}),
}
MEASURES = {
    "figure eight": {"xte_1": "turn 1", "xte_2": "turn 2"},
    "swaths": {"pass_rms": "passes", "headland_rms": "headlands"},
    "figure eight on MuJoCo": {"xte_1": "turn 1", "xte_2": "turn 2"},
    "figure eight on MuJoCo with a heading": {"xte_1": "turn 1", "xte_2": "turn 2"},
}
YAW_LAWS = ("pd", "pd_isgn", "pd_t1fnn", "pd_t2fnn")
RADII = {6: {"path.straight_m": 17, "path.run_in_m": 8}, 15: {"path.straight_m": 42}}


class Row(NamedTuple):
    """One run of the printed laws: its label and what it sets."""

    label: str
    sets: dict[str, Any]


def printed_rows() -> list[Row]:
    """Laws at equal alpha, start values of f, radii and speeds."""
    rows = [Row("pd", P)]
    for alpha in (0.02, 0.05):
        for law in YAW_LAWS[1:]:
            key = "controller.alpha" if law == "pd_isgn" else "controller.network.alpha"
            rows.append(Row(f"{law} alpha {alpha}", {"controller.kind": law, key: alpha}))
    rows.append(Row("pd_isgn alpha 0.04", {"controller.kind": "pd_isgn", "controller.alpha": 0.04}))
    network = {"controller.kind": "pd_t2fnn"}
    rows.append(Row("q frozen", {**network, "controller.network.adapt_q": False}))
    starts = (0.001, 0.003, 0.03, 0.1, 0.2)
    rows += [Row(f"f_init {f}", {**network, "controller.network.f_init": f}) for f in starts]
    for radius, path in RADII.items():
        sets = {"path.radius_m": radius, **path}
        rows += [Row(f"radius {radius} {law}", {"controller.kind": law, **sets}) for law in YAW_LAWS]
    for speed in (0.8, 2.0):
        rows += [Row(f"speed {speed} {law}", {"controller.kind": law, "path.speed_m_s": speed}) for law in YAW_LAWS]
    return [*rows, Row("pd_t2fnn 8 turns", {**network, "path.turns": 8})]


def denominator(log: Log) -> np.ndarray:
    """f (W_lower - W_upper), the denominator of q's law, at every tick [rad]."""
    network = log.scenario.controller.network
    rules = [f"{i}_{j}" for i in range(network.rules_1) for j in range(network.rules_2)]
    parts = [log.column(f"f_{k}") * (log.column(f"w_lower_{k}") - log.column(f"w_upper_{k}")) for k in rules]
    return np.sum(parts, axis=0)


def effective_rate(log: Log, rows: np.ndarray) -> float:
    """Least-squares rate of tau_n over -alpha sgn(tau_c) in these rows [-]."""
    network = log.scenario.controller.network
    sign = np.array([sgn(x, network.delta_s) for x in log.column("tau_c")])[:-1]
    rate = -np.diff(log.column("tau_n")) / TICK_S
    some = rows[:-1]
    return float((rate * sign)[some].sum() / (sign[some] ** 2).sum() / network.alpha)


def printed_numbers(log: Log) -> dict[str, Any]:
    """Per turn: lateral error, and for the network its denominator, effective rate, resting q, broken condition."""
    found: dict[str, Any] = {"mse": [turn["lateral_mse"] for turn in log.metrics["per_turn"]]}
    if "fnn" not in log.scenario.controller.kind:
        return found
    q, size = log.column("q"), np.abs(denominator(log))
    tau_rate = np.abs(np.diff(log.column("tau_c") - log.column("tau_n"))) / TICK_S
    ticks = np.arange(len(q))
    turns = [((ticks >= rows.start) & (ticks < rows.stop))[:-1] for rows in RunView(log).turns]
    found["den"] = [[float(np.median(size[:-1][rows])), float(size[:-1][rows][-1])] for rows in turns]
    found["eff"] = [effective_rate(log, np.append(rows, False)) for rows in turns]
    found["q_rests"] = [float(np.mean(np.diff(q)[rows] == 0)) for rows in turns]
    found["alpha_broken"] = [float(np.mean(tau_rate[rows] >= log.scenario.controller.network.alpha)) for rows in turns]
    return found


def compared_numbers(log: Log) -> dict[str, Any]:
    """Cross-track errors per turn, or on passes and headlands [m], and the travel of the steering [deg]."""
    view, metrics = RunView(log), log.metrics
    found = {f"xte_{turn['turn']}": turn["xte_rms"] for turn in metrics["per_turn"]}
    found["travel_deg"] = float(np.degrees(np.abs(np.diff(log.column("steer"))).sum()))
    if hasattr(log.scenario.path, "passes_s"):
        t, offset = log.column("t"), view.beside.offset.whole()
        on_pass = np.any([(t > start) & (t <= end) for start, end in log.scenario.path.passes_s], axis=0)
        found["pass_rms"] = float(np.sqrt(np.mean(offset[on_pass] ** 2)))
        found["headland_rms"] = float(np.sqrt(np.mean(offset[~on_pass] ** 2)))
        found["headland_max"] = float(np.abs(offset[~on_pass]).max())
    return found


def read(name: str) -> list[dict[str, Any]]:
    """Rows of a study so far."""
    file = RUNS / f"{name}.jsonl"
    return [json.loads(line) for line in file.read_text(encoding="utf-8").splitlines()] if file.exists() else []


def add(name: str, row: Mapping[str, Any]) -> None:
    """One more row; a line is written at once, so that several processes can share the file."""
    RUNS.mkdir(parents=True, exist_ok=True)
    with (RUNS / f"{name}.jsonl").open("a", encoding="utf-8") as file:
        file.write(json.dumps(row) + "\n")
    print({key: row[key] for key in ("surface", "law", "seed", "label", "outcome") if key in row}, flush=True)


def study_printed() -> None:
    """Runs of the printed laws that are not there yet."""
    have = {row["label"] for row in read("printed")}
    for label, sets in printed_rows():
        if label not in have:
            log = run(load_scenario("figure_eight", {**BICYCLE, **sets}))
            add("printed", {"label": label, "outcome": log.outcome, **printed_numbers(log)})


def study_comparison(surfaces: Sequence[str], seeds: Sequence[int]) -> None:
    """Runs of the comparison that are not there yet."""
    have = {(row["surface"], row["law"], row["seed"]) for row in read("comparison")}
    todo = [(surface, law, seed) for surface in surfaces for seed in seeds for law in LAWS]
    for surface, law, seed in todo:
        if (surface, law, seed) not in have:
            name, sets = SURFACES[surface]
            log = run(load_scenario(name, {**sets, **LAWS[law], "seed": seed}))
            key = {"surface": surface, "law": law, "seed": seed, "outcome": log.outcome}
            add("comparison", {**key, **compared_numbers(log)})


def interval(values: Sequence[float]) -> tuple[float, float]:
    """Bootstrap 95 % interval of the mean, 10,000 draws."""
    data = np.asarray(values)
    means = data[np.random.default_rng(1).integers(0, data.size, (10_000, data.size))].mean(axis=1)
    low, high = np.percentile(means, [2.5, 97.5])
    return float(low), float(high)


def comparison_table(surface: str) -> str:
    """Mean error of each law, and the paired differences of the learners from each baseline, in cm."""
    rows = {(row["law"], row["seed"]): row for row in read("comparison") if row["surface"] == surface}
    measures = MEASURES[surface]
    lines = [f"| law | seeds | {' | '.join(f'{name} [cm]' for name in measures.values())} | steering travel [deg] |"]
    lines.append("|---|---:|" + "---:|" * (len(measures) + 1))
    for law in LAWS:
        every = [row for (name, _), row in rows.items() if name == law]
        if mine := [row for row in every if has_errors(row)]:
            means = [f"{100 * np.mean([row[key] for row in mine]):.2f}" for key in measures]
            travel = np.mean([row["travel_deg"] for row in mine])
            seeds = str(len(mine)) if len(mine) == len(every) else f"{len(mine)} (failed {failures(every)})"
            lines.append(f"| {law} | {seeds} | {' | '.join(means)} | {travel:.0f} |")
        elif every:
            lines.append(f"| {law} | 0 (failed {failures(every)}) | {' | '.join('-' * (len(measures) + 1))} |")
    lines += ["", f"| paired difference | seeds | {' | '.join(f'{name} [cm]' for name in measures.values())} |"]
    lines.append("|---|---:|" + "---:|" * len(measures))
    pairs = [(law, base) for law in ("learner + P", "learner + LQR") for base in BASELINES]
    for law, base in [*pairs, ("learner + P", "learner + P, type 1")]:
        pairs_of = [seed for name, seed in rows if name == law and (base, seed) in rows]
        both = [seed for seed in pairs_of if has_errors(rows[law, seed]) and has_errors(rows[base, seed])]
        count = str(len(both)) if len(both) == len(pairs_of) else f"{len(both)} of {len(pairs_of)}"
        if len(both) > 1:
            cells = [_difference([rows[law, s][key] - rows[base, s][key] for s in both]) for key in measures]
            lines.append(f"| {law} less {base} | {count} | {' | '.join(cells)} |")
    return "\n".join(lines)


def _difference(values: Sequence[float]) -> str:
    low, high = interval(values)
    return f"{100 * np.mean(values):+.2f} ({100 * low:+.2f} to {100 * high:+.2f})"


def printed_table() -> str:
    """Lateral mean square error by turn, its gain, and the network's own numbers."""
    names = (
        "turn 1 [m2]",
        "turn 2 [m2]",
        "turn 2 / 1",
        "rate / alpha",
        "denominator [rad]",
        "q rests",
        "condition broken",
    )
    lines = [f"| run | {' | '.join(names)} |", "|---|" + "---:|" * len(names)]
    for row in read("printed"):
        first, second, *more = row["mse"]
        if more:
            continue
        own = ["-"] * 4
        if "eff" in row and "pd_t1fnn" not in row["label"]:
            shares = [f"{100 * row[key][0]:.0f}, {100 * row[key][1]:.0f} %" for key in ("q_rests", "alpha_broken")]
            sizes = f"{row['den'][0][0]:.4f}, {row['den'][1][0]:.4f}"
            own = [f"{row['eff'][0]:.2f}, {row['eff'][1]:.2f}", sizes, *shares]
        lines.append(f"| {row['label']} | {first:.4f} | {second:.4f} | {second / first:.2f} | {' | '.join(own)} |")
    return "\n".join(lines)


def turns_table() -> str:
    """Turn by turn over eight turns: the network's denominator, resting q and rate, and its error."""
    row = next(row for row in read("printed") if row["label"] == "pd_t2fnn 8 turns")
    lines = [
        "| turn | denominator, median [rad] | q rests [%] | rate / alpha | lateral MSE [m2] |",
        "|---|" + "---:|" * 4,
    ]
    for k, (den, rests, rate, mse) in enumerate(zip(row["den"], row["q_rests"], row["eff"], row["mse"], strict=True)):
        lines.append(f"| {k + 1} | {den[0]:.3f} | {100 * rests:.0f} | {rate:.2f} | {mse:.4f} |")
    return "\n".join(lines)


def draw_printed() -> None:
    """q, its law's denominator and tau_n over four turns."""
    log = run(load_scenario("figure_eight", {**BICYCLE, "path.turns": 4}))
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
        save(figure, IMAGES / "learning_printed.png")


def draw_map() -> None:
    """The learnt map after each turn of the figure eight, and after the swaths, beside atan(L kappa)."""
    curvature = np.linspace(-0.4, 0.4, 161)
    with rc_context(STYLE):
        figure = Figure(figsize=(7.0, 2.8), layout="constrained")
        for axis, surface in zip(figure.subplots(1, 2, sharey=True), ("figure eight", "swaths"), strict=True):
            name, sets = SURFACES[surface]
            log = run(load_scenario(name, {**sets, **LEARNER}))
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
        save(figure, IMAGES / "learning_map.png")


def publish() -> None:
    """Tables of the rows that are there."""
    text = PAGE.read_text(encoding="utf-8")
    present = [surface for surface in SURFACES if any(row["surface"] == surface for row in read("comparison"))]
    tables = {surface: comparison_table(surface) for surface in present}
    tables |= {"printed": printed_table(), "turns": turns_table()}
    for name, made in tables.items():
        text = put(text, name, made)
    PAGE.write_text(text, encoding="utf-8")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--part", choices=("all", "printed", "comparison", "publish", "figures"), default="all")
    parser.add_argument("--surfaces", default="figure eight,swaths", help="comma-separated")
    parser.add_argument("--seeds", default="1:21", help="first:last + 1")
    given = parser.parse_args()
    if given.part in ("all", "printed"):
        study_printed()
    if given.part in ("all", "comparison"):
        study_comparison(given.surfaces.split(","), range(*map(int, given.seeds.split(":"))))
    if given.part in ("all", "publish"):
        publish()
    if given.part in ("all", "figures"):
        draw_printed()
        draw_map()


if __name__ == "__main__":
    main()
