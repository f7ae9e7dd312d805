"""Self-contained HTML page with text, tables, interactive charts, and the plotting library.

A chart is plain data, `{"data": [...], "layout": {...}}`, for plotly.js. If `customdata` of a point contains a command,
a click on the point displays the command.
"""

import json
import re
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from math import isfinite
from pathlib import Path
from typing import Any

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.core.palette import BLUE, BRIGHT_BLUE, DARK_GREY, GREEN, ORANGE, PINK, SKY_BLUE, VERMILION, YELLOW
from agrobot_mj.core.version import __version__
from agrobot_mj.simulation.results import write_text

COLOURS = (BLUE, VERMILION, GREEN, ORANGE, PINK, SKY_BLUE, DARK_GREY, "#000000")
"""Colours of groups of runs in charts, in group order."""
Chart = dict[str, Any]
CATEGORIES: dict[str, Any] = {"type": "category", "autorange": "reversed", "automargin": True, "dtick": 1}
"""Layout of a category axis: all names are visible, the first name is on top, and the margin adapts to the names."""
MOST_ROWS, ROW_PX, AROUND_PX = 8, 24, 150
"""Chart heights: number of names that fit a standard chart [-], and height per name and of the margins [pixels]."""
INK, GRID, SHADE, SOFT = "#1b1b1b", "#e5e5e5", "#dddddd", "#999999"
"""Colours of text, grid lines, shaded areas and chart controls."""
DARK = {"#000000": "#f0f0f0", INK: "#e8e8e8", GRID: "#3a3a3a", SHADE: "#4a4a4a", BLUE: BRIGHT_BLUE, SKY_BLUE: YELLOW}
"""Chart colours in dark mode, keyed by the colours in light mode."""
STYLE = """
:root { color-scheme: light dark; --ink: #1b1b1b; --soft: #555; --line: #ddd; --pale: #f5f5f5; --page: #fff; }
@media (prefers-color-scheme: dark) {
  :root { --ink: #e8e8e8; --soft: #aaa; --line: #3a3a3a; --pale: #242424; --page: #161616; }
}
* { box-sizing: border-box; }
body { margin: 0 auto; max-width: 1280px; padding: 1.2rem; font: 16px/1.5 system-ui, sans-serif; color: var(--ink);
  background: var(--page); }
h1 { font-size: 1.6rem; line-height: 1.25; margin: 0.2rem 0; }
h2 { font-size: 1.2rem; margin: 2.2rem 0 0.4rem; border-top: 1px solid var(--line); padding-top: 1.2rem; }
h3 { font-size: 1rem; margin: 0.8rem 0 0.2rem; }
p { max-width: 75ch; margin: 0.4rem 0; }
.facts { color: var(--soft); overflow-wrap: anywhere; }
.grid { display: grid; grid-template-columns: repeat(auto-fit, minmax(min(100%, 420px), 1fr)); gap: 1rem;
  margin-bottom: 1.5rem; }
.small { grid-template-columns: repeat(auto-fill, minmax(min(100%, 260px), 1fr)); }
.card { min-width: 0; }
.chart { width: 100%; height: 380px; }
.card:only-child .map { height: 620px; }
.scroll { margin-bottom: 1rem; overflow-x: auto; background:
  linear-gradient(270deg, var(--page) 1rem, transparent 2rem) no-repeat local,
  linear-gradient(270deg, var(--soft), transparent 0.7rem) no-repeat scroll; }
table { border-collapse: collapse; font-size: 0.9rem; }
th, td { padding: 0.25rem 0.7rem; border-bottom: 1px solid var(--line); text-align: left; white-space: nowrap; }
th { white-space: normal; vertical-align: bottom; }
td.number, th.number { text-align: right; font-variant-numeric: tabular-nums; }
pre { background: var(--pale); padding: 0.7rem; font-size: 0.8rem; white-space: pre-wrap; overflow-wrap: anywhere; }
pre span { display: inline-block; max-width: 100%; }
.small svg { width: 100%; height: auto; background: var(--pale); }
#command { position: sticky; bottom: 0; margin: 0; border-top: 2px solid var(--ink); display: none; z-index: 2; }
@media (max-width: 600px) {
  body { padding: 0.7rem; }
  table { font-size: 0.8rem; }
  th, td { padding: 0.2rem 0.25rem; white-space: normal; }
  .chart, .card:only-child .map { height: 320px; }
}
@media print { #command { display: none !important; } }
"""
SCRIPT = """
const dark = matchMedia("(prefers-color-scheme: dark)").matches;
let recoloured = JSON.stringify(CHARTS);
for (const [light, other] of Object.entries(dark ? DARK : {})) recoloured = recoloured.replaceAll(light, other);
for (const [id, chart] of Object.entries(JSON.parse(recoloured))) {
  const place = document.getElementById(id);
  Plotly.newPlot(place, chart.data, chart.layout, {responsive: true, displaylogo: false});
  place.on("plotly_click", event => {
    const command = event.points[0].customdata;
    if (typeof command !== "string") return;
    const box = document.getElementById("command");
    box.replaceChildren(...command.split(/(?= --)/).map(part => {
      const piece = document.createElement("span");
      piece.textContent = part;
      return piece;
    }));
    box.style.display = "block";
  });
}
"""


class Document:
    """Builder of a self-contained HTML page. Its methods add sections, texts, charts and tables in order."""

    def __init__(self, title: str, facts: Iterable[str]) -> None:
        self.title, self.charts = title, dict[str, Chart]()
        line = " · ".join(escape(fact) for fact in facts)
        self.parts = [f"<h1>{escape(title)}</h1>", f'<p class="facts">{line}</p>']

    def section(self, title: str, text: str = "") -> None:
        """Start a section with a title and an optional paragraph."""
        self.parts.append(f"<h2>{escape(title)}</h2>")
        if text:
            self.text(text)

    def text(self, text: str) -> None:
        """Add a paragraph with the text `text`."""
        self.parts.append(f"<p>{escape(text)}</p>")

    def remarks(self, texts: Iterable[str]) -> None:
        """Add a paragraph for each text, formatted as a sentence."""
        for text in texts:
            self.text(f"{text[0].upper()}{text[1:]}.")

    def grid(self, charts: Sequence[tuple[str, Chart]]) -> None:
        """Add charts with titles, in several columns if the page is wide enough."""
        self.parts.append(f'<div class="grid">{"".join(self._card(*chart) for chart in charts)}</div>')

    def table(self, head: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
        """Add a table, omitting empty columns. Numbers and the heads of columns of numbers are right-aligned."""
        columns = [cells for cells in zip(head, *rows, strict=True) if set(cells[1:]) != {""}]
        marked = [
            [_cell("th", name, all(map(_is_number, cells))), *(_cell("td", cell, _is_number(cell)) for cell in cells)]
            for name, *cells in columns
        ]
        inner = "".join(f"<tr>{''.join(line)}</tr>" for line in zip(*marked, strict=True))
        self.parts.append(f'<div class="scroll"><table>{inner}</table></div>')

    def code(self, title: str, text: str) -> None:
        """Add preformatted text that is shown when its title is clicked."""
        self.parts.append(f"<details><summary>{escape(title)}</summary><pre>{escape(text)}</pre></details>")

    def thumbnails(self, cards: Sequence[tuple[str, str, str]]) -> None:
        """Add small images, each given as a card (title, SVG text, command)."""
        inner = "".join(
            f'<div class="card"><h3>{escape(title)}</h3>{svg}<pre>{unbroken(command)}</pre></div>'
            for title, svg, command in cards
        )
        self.parts.append(f'<div class="grid small">{inner}</div>')

    def write(self, file: Path) -> Path:
        """Write the page atomically and return `file`. Raise `ScenarioError` if plotly is not installed."""
        library = _library()
        charts = json.dumps(self.charts, allow_nan=False).replace("<", "\\u003c")
        text = f"""<!doctype html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">
<title>{escape(self.title)}</title><link rel="icon" href="data:,"><style>{STYLE}</style></head><body>
{"".join(self.parts)}
<p class="facts">Written by agrobot_mj {__version__}; this file works offline.</p>
<pre id="command"></pre>
<script>{library}</script><script>const CHARTS = {charts};
const DARK = {json.dumps(DARK)};{SCRIPT}</script></body></html>
"""
        return write_text(file, text)

    def _card(self, title: str, chart: Chart) -> str:
        name = f"chart{len(self.charts)}"
        self.charts[name] = finite(chart)
        style, vertical = "", chart["layout"].get("yaxis", {})
        kind = "chart map" if "scaleanchor" in vertical else "chart"
        if vertical.get("type") == "category":
            rows = len({y for trace in chart["data"] for y in trace.get("y", ())})
            style = f' style="height: {AROUND_PX + ROW_PX * max(rows, MOST_ROWS)}px"'
        return f'<div class="card"><h3>{escape(title)}</h3><div class="{kind}" id="{name}"{style}></div></div>'


def layout(x: str, y: str, **more: Any) -> dict[str, Any]:
    """Return a chart layout with axis titles `x` and `y`, and with space for a legend and for chart controls."""
    clear = "rgba(0,0,0,0)"
    axis = {"gridcolor": GRID, "zeroline": False, "ticks": "outside", "tickcolor": clear, "automargin": True}
    own = {"xaxis": {**axis, "title": {"text": x}}, "yaxis": {**axis, "title": {"text": y}}}
    for key, value in more.items():
        own[key] = {**own[key], **value} if key in own else value
    legend = {"orientation": "h", "yref": "container", "y": 0, "yanchor": "bottom", "x": 0}
    common = {"margin": {"l": 55, "r": 10, "t": 30, "b": 50}, "legend": legend, "hovermode": "closest"}
    common |= {"plot_bgcolor": clear, "paper_bgcolor": clear}
    common["modebar"] = {"bgcolor": clear, "color": SOFT, "activecolor": INK}
    return {**common, "font": {"family": "system-ui, sans-serif", "size": 12, "color": INK}, **own}


def unbroken(command: str) -> str:
    """Return a command as HTML with line breaks only before options."""
    return "".join(f"<span>{escape(part)}</span>" for part in re.split(r"(?= --)", command))


def error_bars(middle: Sequence[float], ends: Iterable[Sequence[float]]) -> Chart:
    """Return asymmetric error bars for the values `middle`. `ends` contains the lower and upper end of each bar."""
    pairs = list(zip(middle, ends, strict=True))
    upper, lower = [high - m for m, (_, high) in pairs], [m - low for m, (low, _) in pairs]
    return {"type": "data", "symmetric": False, "array": upper, "arrayminus": lower}


def finite(value: Any) -> Any:
    """Return plain data with floats rounded to six digits, and with None in place of NaN and infinite values."""
    if isinstance(value, Mapping):
        return {key: finite(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [finite(each) for each in value]
    if isinstance(value, float):
        return float(f"{value:.6g}") if isfinite(value) else None
    return value


def _is_number(value: object) -> bool:
    return isinstance(value, int | float | None) and not isinstance(value, bool)


def _cell(tag: str, value: object, right: bool) -> str:
    digits = ".0f" if isinstance(value, float) and abs(value) >= 1000 else ".3g"
    text = "-" if value is None else f"{value:{digits}}" if isinstance(value, float) else str(value)
    number = ' class="number"' if right else ""
    return f"<{tag}{number}>{escape(text).replace('_', '_<wbr>')}</{tag}>"


def _library() -> str:
    try:
        from plotly.offline import get_plotlyjs
    except ImportError:
        raise ScenarioError("report: plotly is not installed; pip install 'agrobot-mj[report]'") from None
    return str(get_plotlyjs()).replace("</script>", "<\\/script>")
