"""Report pages of searches, and the section on importance in the report page of a sweep."""

import json
import tomllib
from pathlib import Path
from typing import Any

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.extensions.search.importance.results import DESIGNS, importance, importance_rows, importance_texts
from agrobot_mj.extensions.search.importance.shares import Influence
from agrobot_mj.studies.pages.document import CATEGORIES, COLOURS, INK, SHADE, Chart, Document, error_bars, layout
from agrobot_mj.studies.pages.ranking import METRIC
from agrobot_mj.studies.pages.report import Reports
from agrobot_mj.studies.results_io import code_of


def limit_page(folder: Path) -> Document:
    """Return the report page of the limit search whose results are in `folder`."""
    found = json.loads((folder / "limit.json").read_text("utf-8"))
    facts = [f"scenario {found['scenario']}", f"a run fails when {found['until']}", f"agrobot_mj {found['version']}"]
    facts.append(code_of([found], folder))
    page = Document(f"Limits along {found['key']}", facts)
    page.section("Answer")
    for law in found["laws"]:
        page.text(f"{law['statement']}.")
    shown = f"Bars: {100 * found['confidence']:g} % interval. Grey: interval of the limit. Dashed: required rate."
    page.section("Success", shown)
    page.grid([(law["law"], _success(law, found)) for law in found["laws"]])
    page.section("All evaluated values")
    head = ("law", found["key"], "runs", "failed", "outcomes")
    rows = [
        (
            law["law"],
            f"{t['value']:g}",
            t["runs"],
            t["failed"],
            ", ".join(f"{count} {outcome}" for outcome, count in t["outcomes"].items()),
        )
        for law in found["laws"]
        for t in law["tried"]
    ]
    page.table(head, rows)
    return page


def _success(law: dict[str, Any], found: dict[str, Any]) -> Chart:
    tried = law["tried"]
    rates = [100 * (1 - t["failed"] / t["runs"]) for t in tried]
    bars = error_bars(rates, [(100 * t["low"], 100 * t["high"]) for t in tried])
    curve = {"type": "scatter", "mode": "lines+markers", "x": [t["value"] for t in tried], "y": rates, "error_y": bars}
    required = {"y0": 100 * found["reliability"], "y1": 100 * found["reliability"], "xref": "paper", "x0": 0, "x1": 1}
    shapes: list[dict[str, Any]] = [{"type": "line", **required, "line": {"color": INK, "width": 1, "dash": "dash"}}]
    if law["interval"]:
        low, high = law["interval"]
        limits = {"type": "rect", "x0": low, "x1": high, "y0": 0, "y1": 1, "yref": "paper", "fillcolor": SHADE}
        shapes.append({**limits, "layer": "below", "line": {"width": 0}})
    own = layout(found["key"], "successful runs [%]", shapes=shapes, yaxis={"range": [-5, 105]})
    return {"data": [{**curve, "line": {"color": COLOURS[0]}}], "layout": own}


def importance_section(page: Document, folder: Path, metric: str | None) -> list[Path]:
    """Add a section on the importance of parameters to the report page of a sweep. Return the written files.

    If `metric` is None, no section is added for an unsuitable design, and missing results are explained. Raises
    `ScenarioError` if the importance for a given `metric` cannot be computed.
    """
    file = tomllib.loads((folder / "sweep.toml").read_text("utf-8"))
    if metric is None and file.get("method") not in DESIGNS:
        return []
    shown = metric or METRIC
    try:
        found = importance(folder, shown)
    except ScenarioError as error:
        if metric is not None:
            raise
        page.section("Importance", f"Not available. {error}")
        return []
    page.section("Importance", f"Fraction of the variance of {shown} attributed to each number.")
    page.table(*importance_rows(found))
    for text in importance_texts(found, shown):
        page.text(text)
    page.grid([(each.group, _shares(each, shown)) for each in found])
    return [folder / "importance.json", folder / "importance.png"]


def _shares(each: Influence, metric: str) -> Chart:
    parts = {"share": [(s.share, s.low, s.high) for s in each.shares]}
    if each.unexplained is None:
        parts["first order"] = [(s.effect, s.effect - s.half, s.effect + s.half) for s in each.shares]
    common = {"type": "bar", "orientation": "h", "y": [s.key for s in each.shares]}
    data = [
        {**common, "name": name, "x": (middle := [m for m, *_ in ends]), "marker": {"color": COLOURS[k]},
         "error_x": error_bars(middle, [(low, high) for _, low, high in ends])}
        for k, (name, ends) in enumerate(parts.items())
    ]  # fmt: skip
    return {"data": data, "layout": layout(f"fraction of the variance of {metric} [-]", "", yaxis=CATEGORIES)}


REPORTS = Reports(
    pages={
        "limit.json": limit_page,
        **{
            f"{name}.json": f"{name} has no report; its results are in {name}.json and {name}.png"
            for name in ("risk", "falsify")
        },
        "tuning.json": "tune has no report; its result is in tuning.json",
    },
    sections={"sweep.parquet": importance_section},
)
