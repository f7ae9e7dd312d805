"""Report pages of a single run and of a comparison."""

import json
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq

from agrobot_mj.core.palette import BLACK
from agrobot_mj.core.signals import Array
from agrobot_mj.metrics import unit_of
from agrobot_mj.metrics.success import failures
from agrobot_mj.simulation.diagnosis import attribution
from agrobot_mj.studies.pages.document import COLOURS, Chart, Document, layout
from agrobot_mj.studies.pages.ranking import CENTIMETRES, Group, add_ranking, rank_groups
from agrobot_mj.studies.results_io import code_of

MOST_POINTS = 2500
"""Maximum number of points of a curve. Longer signals are reduced to the extremes of blocks of points."""
SIGNALS = ("t", "x", "y", "x_ref", "y_ref", "x_hat", "y_hat", "e_lateral", "e_longitudinal", "speed", "steer")
MORE = ("speed_ref", "steer_ref", "tau_c", "tau_n", "gnss_quality", "roll", "pitch", "implement_x", "implement_y")
LARGEST_DRAWN, MOST_TIMES = 0.1, 500
"""Maximum drawn size of a magnified cross-track error [fraction of the map size], and maximum magnification [-]."""
Signals = dict[str, Array]
Rows = Sequence[Mapping[str, Any]]
APART = "The runs cover different segments of the path, so errors of different rankings are not comparable."


def read_signals(folder: Path) -> Signals:
    """Return the logged signals of a run as arrays of shape (n,), by column name."""
    file = (folder / "signals.parquet").absolute()
    there = set(pq.read_schema(file).names)
    table = pq.read_table(file, columns=[name for name in (*SIGNALS, *MORE) if name in there])
    return {name: np.asarray(table[name].to_numpy(), dtype=float) for name in table.column_names}


def thin_rows(*columns: Array, most: int = MOST_POINTS) -> list[Array]:
    """Return about `most` rows of columns of shape (n,).

    The minimum and maximum of each column in each block of rows are kept, so that spikes remain visible. A block
    without values remains a gap.
    """
    n = len(columns[0])
    if n <= most:
        return list(columns)
    stretches = np.array_split(np.arange(n), max(1, most // (2 * len(columns))))
    kept = {0, n - 1}
    for column in columns:
        for rows in stretches:
            values = column[rows]
            finite = rows[np.isfinite(values)]
            if len(finite):
                kept |= {int(finite[column[finite].argmin()]), int(finite[column[finite].argmax()])}
            if np.isnan(values[0]):
                kept.add(int(rows[0]))
    chosen = sorted(kept)
    return [column[chosen] for column in columns]


def line(x: Array, y: Array, name: str, colour: str, **more: Any) -> Chart:
    """Return the curve of `y` over `x`, both (n,), as plain chart data with about `MOST_POINTS` points or fewer."""
    style = {"color": colour, "width": more.pop("width", 1.5), "dash": more.pop("dash", "solid")}
    x, y = thin_rows(x, y)
    return {"type": "scatter", "mode": "lines", "x": x.tolist(), "y": y.tolist(), "name": name, "line": style, **more}


def across(s: Signals) -> tuple[Array, Array]:
    """Return the unit vectors to the left of the reference path (n, 2), and lateral offsets of the track (n,) [m]."""
    points = np.stack([s["x_ref"], s["y_ref"]], 1)
    along = np.gradient(points, axis=0) if len(points) > 1 else np.zeros_like(points)
    moves = np.hypot(*along.T) > 1e-9
    along = along[np.maximum.accumulate(np.where(moves, np.arange(len(points)), 0))]  # keep direction at rest
    left = np.stack([-along[:, 1], along[:, 0]], 1) / np.maximum(np.hypot(*along.T), 1e-9)[:, None]
    return left, ((np.stack([s["x"], s["y"]], 1) - points) * left).sum(axis=1)


def implement_of(s: Signals) -> Signals:
    """Return the signals with the position of the implement in place of the tractor position, or {} for a run without
    an implement."""
    return {**s, "x": s["implement_x"], "y": s["implement_y"]} if "implement_x" in s else {}


def enlargement(tractors: Iterable[Signals]) -> int:
    """Return the magnification of cross-track errors in a map [-]: 1, 2 or 5 times a power of ten."""
    runs = [s for tractor in tractors for s in (tractor, implement_of(tractor)) if s]
    extent = max(float(np.nanmax(np.ptp([s["x_ref"], s["y_ref"]], axis=1))) for s in runs)
    largest = max(float(np.nanmax(np.abs(across(s)[1]), initial=0.0)) for s in runs)
    most = min(LARGEST_DRAWN * extent / max(largest, 1e-9), MOST_TIMES)
    return max((k * 10**n for n in range(3) for k in (1, 2, 5) if k * 10**n <= most), default=1)


def enlarge(s: Signals, times: int) -> tuple[Array, Array]:
    """Return x and y (n,) [m] of the track with cross-track errors magnified by the factor `times`."""
    left, off = across(s)
    x, y = np.stack([s["x"], s["y"]]) + (times - 1) * off * left.T
    return x, y


def map_of(runs: Mapping[str, Signals]) -> tuple[str, Chart]:
    """Return the title and chart of a map of runs. Title and axis label state any magnification of the errors."""
    first, times = next(iter(runs.values())), enlargement(runs.values())
    data = [line(first["x_ref"], first["y_ref"], "reference", BLACK, width=1, dash="dot")]
    for k, (name, s) in enumerate(runs.items()):
        parts = {name: ("solid", s), f"{name}: implement": ("dash", implement_of(s))}
        colour = COLOURS[k % len(COLOURS)]
        data += [line(*enlarge(own, times), part, colour, dash=dash) for part, (dash, own) in parts.items() if own]
    own = layout(f"east [m]{magnification_text(times)}", "north [m]", yaxis={"scaleanchor": "x"})
    chart = {"data": data, "layout": own}
    return f"Map{magnification_text(times)}", chart


def magnification_text(times: int) -> str:
    """Return the part of a title that states the magnification of cross-track errors, or "" for a map to scale."""
    return f", cross-track errors enlarged {times} times" if times > 1 else ""


def _errors(runs: Mapping[str, Signals]) -> tuple[str, Chart]:
    """Return the title and chart of the lateral errors over time, with one curve per run."""
    curves = {name: (s["t"], -CENTIMETRES * s["e_lateral"]) for name, s in runs.items() if "e_lateral" in s}
    return "Lateral error", _curves("lateral error, left + [cm]", curves)


def _curves(label: str, curves: Mapping[str, tuple[Array, Array]]) -> Chart:
    data = [
        line(t, values, name, COLOURS[k % len(COLOURS)])
        for k, (name, (t, values)) in enumerate(curves.items())
        if np.isfinite(values).any()
    ]
    return {"data": data, "layout": layout("time [s]", label)}


def run_page(folder: Path) -> Document:
    """Return the report page of a single run."""
    metrics = json.loads((folder / "metrics.json").read_text("utf-8"))
    text = (folder / "scenario.toml").read_text("utf-8")
    scenario, signals = tomllib.loads(text), read_signals(folder)
    title = scenario.get("title") or scenario.get("name") or folder.name
    about = [f"outcome: {metrics['outcome']}", f"identity {metrics.get('identity', 'unknown')}"]
    page = Document(title, facts(scenario, *about))
    page.section("Track", "Drag to zoom; double-click to reset the view.")
    estimate = {name: signals[name] for name in ("x_ref", "y_ref")} | {"x": signals["x_hat"], "y": signals["y_hat"]}
    page.grid([map_of({"tractor": signals, "estimate": estimate}), _errors({"run": signals})])
    page.remarks(filter(None, (attribution(metrics), metrics.get("estimate_warning"))))
    page.section("Steering and speed")
    page.grid([("Steering", _pair(signals, "steer", "steering angle [deg]", 180 / np.pi))])
    page.grid([("Speed", _pair(signals, "speed", "speed [m/s]", 1.0)), *_shares(signals)])
    page.section("Numbers")
    numbers = [(k, v, unit_of(k)) for k, v in metrics.items() if not isinstance(v, list | dict)]
    page.table(("metric", "value", "unit"), numbers)
    page.code("scenario.toml", text)
    return page


def facts(scenario: Mapping[str, Any], *more: str) -> list[str]:
    """Return the facts at the head of a page: scenario name, seed, plant, guidance and version."""
    plant, guidance = scenario.get("plant", {}), scenario.get("guidance", {})
    found = [f"scenario {scenario.get('name', '?')}", *more, f"seed {scenario.get('seed', '?')}"]
    found += [f"plant {plant['kind']}"] if "kind" in plant else []
    found += [f"guidance {guidance['kind']}"] if "kind" in guidance else []
    return [*found, f"agrobot_mj {scenario.get('version', '?')}"]


def _pair(signals: Signals, column: str, label: str, factor: float) -> Chart:
    pairs = {"true": column, "reference": f"{column}_ref"}
    return _curves(label, {who: (signals["t"], factor * signals[c]) for who, c in pairs.items() if c in signals})


def _shares(signals: Signals) -> list[tuple[str, Chart]]:
    if not np.nan_to_num(signals.get("tau_n", np.zeros(1))).any():
        return []
    parts = {"network": -np.degrees(signals["tau_n"]), "PD": np.degrees(signals["tau_c"])}
    curves = {name: (signals["t"], values) for name, values in parts.items()}
    return [("Parts of the steering command", _curves("steering [deg]", curves))]


def comparison_page(folder: Path) -> Document:
    """Return the report page of a comparison: rankings, and maps and lateral errors of the first seed."""
    rows = json.loads((folder / "comparison.json").read_text("utf-8"))
    places: dict[str, list[dict[str, Any]]] = {}
    for row in rows:
        places.setdefault(f"{row['plant']}: {_law(row)}", []).append(row)
    seeds = sorted({row["seed"] for row in rows})
    files = sorted(folder.glob("*/scenario.toml"))
    text = files[0].read_text("utf-8") if files else ""
    scenario = tomllib.loads(text)
    seen = f"{len(rows)} runs, seed" + (f"s {seeds[0]} to {seeds[-1]}" if len(seeds) > 1 else f" {seeds[0]}")
    about = [f"scenario {scenario.get('name', folder.name)}", seen, f"agrobot_mj {scenario.get('version', '?')}"]
    about.append(code_of(rows, folder))
    page = Document(f"Comparison: {scenario.get('title') or folder.name}", about)
    _add_rankings(page, places)
    for plant in dict.fromkeys(row["plant"] for row in rows):
        first = [row for row in rows if (row["plant"], row["seed"]) == (plant, seeds[0])]
        chosen = [(_law_label(row), folder / row["folder"]) for row in first]
        runs = {name: read_signals(place) for name, place in chosen if (place / "signals.parquet").exists()}
        if runs:
            page.section(f"On the plant {plant}", f"Runs of seed {seeds[0]}.")
            page.grid([map_of(runs), _errors(runs)])
    page.code("scenario.toml of the first run", text)
    return page


def _law(row: Mapping[str, Any]) -> str:
    """Return the name of the law in a table row, taken from the name of the run folder (plant-law-seed)."""
    return str(row["folder"]).removeprefix(f"{row['plant']}-").removesuffix(f"-s{row['seed']}")


def _add_rankings(page: Document, places: Mapping[str, Rows]) -> None:
    """Add one ranking per path segment, because errors on different segments are not comparable."""
    pieces = dict.fromkeys(rows[0].get("piece") for rows in places.values())
    laws = list(dict.fromkeys(_law(row) for rows in places.values() for row in rows))
    for number, piece in enumerate(pieces, 1):
        groups = rank_groups(Group(name, rows) for name, rows in places.items() if rows[0].get("piece") == piece)
        colours = [COLOURS[laws.index(_law(group.rows[0])) % len(COLOURS)] for group in groups]
        title, text = (f"Ranking on segment {number} of the path", APART) if len(pieces) > 1 else ("Ranking", "")
        add_ranking(page, groups, title, text, colours)


def _law_label(row: Mapping[str, Any]) -> str:
    text = failures([row])
    return f"{_law(row)} (failed {text})" if text else _law(row)


def thumbnail(signals: Signals, times: int = 1) -> str:
    """Return a small SVG image of the path and the track, with cross-track errors magnified by the factor `times`."""
    x, y, track = signals["x_ref"], signals["y_ref"], enlarge(signals, times)
    points = np.concatenate([np.stack([x, y], 1), np.stack(track, 1)])
    points = points[np.isfinite(points).all(axis=1)]
    low, high = points.min(axis=0), points.max(axis=0)
    size = float(max(*(high - low), 1.0))
    scale, (width, height) = 200 / size, (high - low) * 200 / size

    def trace(xs: Array, ys: Array, colour: str, stroke: float) -> str:
        xs, ys = thin_rows(xs, ys, most=400)
        pairs = zip((xs - low[0]) * scale, (high[1] - ys) * scale, strict=True)
        text = " ".join(f"{a:.1f},{b:.1f}" for a, b in pairs if np.isfinite(a) and np.isfinite(b))
        return f'<polyline points="{escape(text)}" fill="none" stroke="{colour}" stroke-width="{stroke}"/>'

    box = f"-5 -5 {max(width, 1) + 10:.0f} {max(height, 1) + 10:.0f}"
    lines = trace(x, y, "currentColor", 1) + trace(*track, COLOURS[1], 1.5)
    return f'<svg viewBox="{box}" role="img" aria-label="track">{lines}</svg>'
