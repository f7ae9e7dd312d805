"""Report page with the results of a validation, read from `validation.json`."""

import json
from pathlib import Path
from typing import Any

from agrobot_mj.studies.pages.document import CATEGORIES, COLOURS, INK, Chart, Document, layout
from agrobot_mj.studies.pages.report import Reports

NUMBERS = ("quantity", "subject", "measured", "theory", "unit", "band")


def validation_page(folder: Path) -> Document:
    """Return the report page of the validation in `folder`: all measured values and their positions in the acceptance
    bands."""
    checks = json.loads((folder / "validation.json").read_text("utf-8"))
    judged = [check for check in checks if check["band"] != "reported"]
    failed = [check for check in judged if not check["passed"]]
    fact = f"{len(judged) - len(failed)} of {len(judged)} numbers are inside their bands"
    page = Document("Validation against theory", [fact, f"{len(checks) - len(judged)} more are reported"])
    page.section("Positions in the bands", "0 is the middle of a band with two ends; -1 and 1 are the ends.")
    page.grid([("All numbers with a band", _bands(judged))])
    for manoeuvre in dict.fromkeys(check["manoeuvre"] for check in checks):
        page.section(manoeuvre.capitalize())
        own = [check for check in checks if check["manoeuvre"] == manoeuvre]
        ends = ["" if check["band"] == "reported" else "inside" if check["passed"] else "OUTSIDE" for check in own]
        rows = [(*(check[name] for name in NUMBERS), end) for check, end in zip(own, ends, strict=True)]
        page.table((*NUMBERS, ""), rows)
    return page


def _bands(judged: list[dict[str, Any]]) -> Chart:
    data = []
    for k, subject in enumerate(dict.fromkeys(check["subject"] for check in judged)):
        points = [(c, place) for c in judged if c["subject"] == subject and (place := _place(c)) is not None]
        data.append(
            {"type": "scatter", "mode": "markers", "name": subject, "x": [place for _, place in points],
             "y": [c["manoeuvre"] for c, _ in points], "text": [c["quantity"] for c, _ in points],
             "hovertemplate": "%{text}<extra>%{fullData.name}</extra>",
             "marker": {"color": COLOURS[k % len(COLOURS)], "size": 8, "opacity": 0.7}}
        )  # fmt: skip
    ends = {"type": "line", "y0": 0, "y1": 1, "yref": "paper", "line": {"dash": "dot", "color": INK}}
    shapes = [{**ends, "x0": x, "x1": x} for x in (-1, 1)]
    data = [trace for trace in data if trace["x"]]
    return {"data": data, "layout": layout("position in the band [-]", "", shapes=shapes, yaxis=CATEGORIES)}


def _place(check: dict[str, Any]) -> float | None:
    low, high, measured = check["low"], check["high"], check["measured"]
    if low is None or high is None or measured is None or high <= low:
        return None
    return float((2 * measured - low - high) / (high - low))


REPORTS = Reports({"validation.json": validation_page})
