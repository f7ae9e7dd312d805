"""Pages of what has been driven: a run, and a comparison of several."""

import json
import tomllib
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from statistics import fmean
from typing import Any

import numpy as np
import pyarrow.parquet as pq

from agrobot_mj.core.signals import Array
from agrobot_mj.studies.pages.document import CATEGORIES, COLOURS, Chart, Document, layout

MOST_POINTS = 2500
"""Points of a curve; longer signals are thinned out."""
SIGNALS = ("t", "x", "y", "x_ref", "y_ref", "x_hat", "y_hat", "e_lateral", "e_longitudinal", "speed", "steer")
MORE = ("speed_ref", "steer_ref", "tau_c", "tau_n", "gnss_quality", "roll", "pitch")
CENTIMETRES = 100.0
Signals = dict[str, Array]


def read_signals(folder: Path) -> Signals:
    """Signals of a run as arrays of equal length, shape (n,), thinned out."""
    file = (folder / "signals.parquet").absolute()
    there = set(pq.read_schema(file).names)
    table = pq.read_table(file, columns=[name for name in (*SIGNALS, *MORE) if name in there])
    step = max(1, table.num_rows // MOST_POINTS)
    return {name: np.asarray(table[name].to_numpy(), dtype=float)[::step] for name in table.column_names}


def line(x: Array, y: Array, name: str, colour: str, **more: Any) -> Chart:
    """A curve of a chart."""
    style = {"color": colour, "width": more.pop("width", 1.5), "dash": more.pop("dash", "solid")}
    return {"type": "scatter", "mode": "lines", "x": x.tolist(), "y": y.tolist(), "name": name, "line": style, **more}


def chart_of_tracks(runs: Mapping[str, Signals]) -> Chart:
    """A map: reference and tracks."""
    first = next(iter(runs.values()))
    data = [line(first["x_ref"], first["y_ref"], "reference", "#000000", width=1, dash="dot")]
    data += [line(s["x"], s["y"], name, COLOURS[k % len(COLOURS)]) for k, (name, s) in enumerate(runs.items())]
    return {"data": data, "layout": layout("east [m]", "north [m]", yaxis={"scaleanchor": "x"})}


def chart_over_time(runs: Mapping[str, Signals], column: str, label: str, factor: float = 1.0) -> Chart:
    """One signal of all runs over time."""
    curves = [
        line(s["t"], factor * s[column], name, COLOURS[k % len(COLOURS)])
        for k, (name, s) in enumerate(runs.items())
        if column in s and np.isfinite(s[column]).any()
    ]
    return {"data": curves, "layout": layout("time [s]", label)}


def run_page(folder: Path) -> Document:
    """The page of one run."""
    metrics = json.loads((folder / "metrics.json").read_text("utf-8"))
    text = (folder / "scenario.toml").read_text("utf-8")
    scenario, signals = tomllib.loads(text), read_signals(folder)
    title = scenario.get("title") or scenario.get("name") or folder.name
    page = Document(title, facts(scenario, f"outcome: {metrics['outcome']}"))
    page.section("Where it went", "Scroll or pinch to zoom, drag to pan, double-click to see everything again.")
    estimate = {**signals, "x": signals["x_hat"], "y": signals["y_hat"]}
    error = chart_over_time({"run": signals}, "e_lateral", "lateral error, left + [cm]", -CENTIMETRES)
    page.grid([("Map", chart_of_tracks({"tractor": signals, "estimate": estimate})), ("Lateral error", error)])
    page.section("What it did")
    page.grid([("Steering", _pair(signals, "steer", "steering angle [deg]", 180 / np.pi))])
    page.grid([("Speed", _pair(signals, "speed", "speed [m/s]", 1.0)), *_shares(signals)])
    page.section("Numbers")
    page.table(("metric", "value"), [(k, v) for k, v in metrics.items() if not isinstance(v, list | dict)])
    page.code("scenario.toml", text)
    return page


def facts(scenario: Mapping[str, Any], *more: str) -> list[str]:
    """What identifies the runs of a scenario."""
    plant, guidance = scenario.get("plant", {}), scenario.get("guidance", {})
    found = [f"scenario {scenario.get('name', '?')}", *more, f"seed {scenario.get('seed', '?')}"]
    found += [f"plant {plant['kind']}"] if "kind" in plant else []
    found += [f"guidance {guidance['kind']}"] if "kind" in guidance else []
    return [*found, f"agrobot_mj {scenario.get('version', '?')}"]


def _pair(signals: Signals, column: str, label: str, factor: float) -> Chart:
    """A signal and its reference over time."""
    pairs = {"true": column, "reference": f"{column}_ref"}
    curves = [
        line(signals["t"], factor * signals[name], who, COLOURS[k])
        for k, (who, name) in enumerate(pairs.items())
        if name in signals and np.isfinite(signals[name]).any()
    ]
    return {"data": curves, "layout": layout("time [s]", label)}


def _shares(signals: Signals) -> list[tuple[str, Chart]]:
    """Parts of the steering command, for controllers that have a network."""
    if not np.nan_to_num(signals.get("tau_n", np.zeros(1))).any():
        return []
    degrees = 180 / np.pi
    curves = [
        line(signals["t"], degrees * signals["tau_c"], "PD", COLOURS[1]),
        line(signals["t"], -degrees * signals["tau_n"], "network", COLOURS[0]),
    ]
    return [("Parts of the steering command", {"data": curves, "layout": layout("time [s]", "steering [deg]")})]


def comparison_page(folder: Path) -> Document:
    """The page of a comparison: ranking, maps and errors of its first seed."""
    rows = json.loads((folder / "comparison.json").read_text("utf-8"))
    places: dict[str, list[dict[str, Any]]] = {}
    for row in rows:
        places.setdefault(f"{row['plant']}: {_law(row)}", []).append(row)
    seeds = sorted({row["seed"] for row in rows})
    files = sorted(folder.glob("*/scenario.toml"))
    text = files[0].read_text("utf-8") if files else ""
    scenario = tomllib.loads(text)
    seen = (
        f"{len(rows)} runs, seeds {seeds[0]} to {seeds[-1]}" if len(seeds) > 1 else f"{len(rows)} runs, seed {seeds[0]}"
    )
    facts_ = [f"scenario {scenario.get('name', folder.name)}", seen, f"agrobot_mj {scenario.get('version', '?')}"]
    page = Document(f"Comparison: {scenario.get('title') or folder.name}", facts_)
    page.section("Ranking", "Cross-track error, rms over a run. Bars: mean over the seeds; points: runs.")
    page.grid([("Cross-track rms", _ranking(places))])
    head = ("case", "runs", "completed", "xte rms [cm]", "xte 95 % [cm]", "lateral rms [cm]")
    page.table(head, [_summary(name, each) for name, each in places.items()])
    for plant in dict.fromkeys(row["plant"] for row in rows):
        chosen = [(_law(row), folder / row["folder"]) for row in rows if _is_first(row, plant, seeds[0])]
        runs = {name: read_signals(place) for name, place in chosen if (place / "signals.parquet").exists()}
        if runs:
            page.section(f"On the plant {plant}", f"Runs of seed {seeds[0]}.")
            error = chart_over_time(runs, "e_lateral", "lateral error, left + [cm]", -CENTIMETRES)
            page.grid([("Map", chart_of_tracks(runs)), ("Lateral error", error)])
    page.code("scenario.toml of the first run", text)
    return page


def _law(row: Mapping[str, Any]) -> str:
    """Name of the law of a row, as its folder has it: plant, law, seed."""
    return str(row["folder"]).removeprefix(f"{row['plant']}-").removesuffix(f"-s{row['seed']}")


def _is_first(row: Mapping[str, Any], plant: str, seed: int) -> bool:
    return bool(row["plant"] == plant and row["seed"] == seed)


def _numbers(rows: Sequence[Mapping[str, Any]], name: str) -> list[float]:
    return [CENTIMETRES * row[name] for row in rows if row.get(name) is not None]


def _summary(name: str, rows: Sequence[Mapping[str, Any]]) -> tuple[object, ...]:
    means = [fmean(v) if (v := _numbers(rows, key)) else None for key in ("xte_rms", "xte_abs_p95", "lateral_rms")]
    return (name, len(rows), sum(row["outcome"] == "completed" for row in rows), *means)


def _ranking(places: Mapping[str, list[dict[str, Any]]]) -> Chart:
    """Mean and single runs of each case, best first."""
    values = {name: _numbers(rows, "xte_rms") for name, rows in places.items()}
    order = sorted((name for name in values if values[name]), key=lambda name: fmean(values[name]))
    bars = {"type": "bar", "orientation": "h", "y": order, "x": [fmean(values[name]) for name in order], "name": "mean"}
    points = [(name, value) for name in order for value in values[name]]
    dots = {
        "type": "scatter",
        "mode": "markers",
        "y": [n for n, _ in points],
        "x": [v for _, v in points],
        "name": "runs",
    }
    own = layout("cross-track rms [cm]", "", yaxis=CATEGORIES, showlegend=False)
    colours = {"marker": {"color": COLOURS[5]}}, {"marker": {"color": "#000000", "size": 5}}
    return {"data": [{**bars, **colours[0]}, {**dots, **colours[1]}], "layout": own}


def thumbnail(signals: Signals) -> str:
    """A small picture of a track (colour) and its reference (black), as SVG."""
    x, y = signals["x_ref"], signals["y_ref"]
    points = np.concatenate([np.stack([x, y], 1), np.stack([signals["x"], signals["y"]], 1)])
    points = points[np.isfinite(points).all(axis=1)]
    low, high = points.min(axis=0), points.max(axis=0)
    size = float(max(*(high - low), 1.0))
    scale, (width, height) = 200 / size, (high - low) * 200 / size

    def trace(xs: Array, ys: Array, colour: str, stroke: float) -> str:
        step = max(1, len(xs) // 300)
        pairs = zip((xs - low[0])[::step] * scale, (high[1] - ys)[::step] * scale, strict=True)
        text = " ".join(f"{a:.1f},{b:.1f}" for a, b in pairs if np.isfinite(a) and np.isfinite(b))
        return f'<polyline points="{escape(text)}" fill="none" stroke="{colour}" stroke-width="{stroke}"/>'

    box = f"-5 -5 {max(width, 1) + 10:.0f} {max(height, 1) + 10:.0f}"
    lines = trace(x, y, "#000000", 1) + trace(signals["x"], signals["y"], COLOURS[1], 1.5)
    return f'<svg viewBox="{box}" role="img" aria-label="track">{lines}</svg>'
