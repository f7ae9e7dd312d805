"""Common figure style: sizes for a journal page (columns of 3.5 in, text of 8 pt), colours and law names."""

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from agrobot_mj.core.identity import code_text
from agrobot_mj.core.palette import (
    BLUE,
    BROWN,
    GREEN,
    OLIVE,
    ORANGE,
    PINK,
    ROYAL_BLUE,
    SKY_BLUE,
    VERMILION,
    WINE,
    YELLOW,
)
from agrobot_mj.core.spec import Spec, members
from agrobot_mj.core.version import __version__
from agrobot_mj.scenario.schema import Scenario
from agrobot_mj.simulation.results import atomic

COLOURS = {"pd": VERMILION, "pd_isgn": ORANGE, "pd_t1fnn": GREEN, "pd_t2fnn": BLUE}
SPARE_COLOURS = (PINK, SKY_BLUE, BROWN, YELLOW, ROYAL_BLUE, WINE, OLIVE)
"""Colours of laws without an assigned colour, in the order of the laws. Grey is excluded, because the reference
is black or grey."""
STYLE: dict[Any, Any] = {
    "font.size": 8,
    **{f"{part}.labelsize": 8 for part in ("axes", "xtick", "ytick")},
    "axes.titlesize": 8,
    "axes.linewidth": 0.6,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.xmargin": 0.01,
    "grid.linewidth": 0.3,
    "grid.color": "#CCCCCC",
    "legend.fontsize": 8,
    "legend.frameon": False,
    "lines.linewidth": 0.9,
}
PANEL_WIDTH_IN = 3.5
DPI = 200


def law_name(kind: str) -> str:
    """Return the name used in figures for the law of a given `kind`. Unknown kinds are returned unchanged."""
    fields = (Scenario.model_fields[family] for family in ("guidance", "controller"))
    law = next((law for field in fields if (law := members(field.annotation).get(kind))), Spec)
    return str(vars(law).get("label", kind))


def write_figure(file: Path, draw: Callable[..., Figure], *arguments: Any) -> Path:
    """Draw a figure with `draw(*arguments)` in the common style, save it, and return the file."""
    with mpl.rc_context(STYLE):
        return save(draw(*arguments), file)


def write_figures(folder: Path, draws: Iterable[Callable[..., Figure | None]], *arguments: Any) -> list[Path]:
    """Draw figures in the common style, and save each as a PNG file named after its function. Return the files.

    A function returns None if there are no data for its figure.
    """
    with mpl.rc_context(STYLE):
        drawn = {draw.__name__: draw(*arguments) for draw in draws}
        return [save(figure, folder / f"{name}.png") for name, figure in drawn.items() if figure is not None]


def save(figure: Figure, file: Path) -> Path:
    """Save a figure atomically as PNG with the code identity in its metadata. Return the file."""
    about = {"Software": f"agrobot_mj {__version__}", "Comment": f"code {code_text()}"}
    with atomic(file) as part:
        FigureCanvasAgg(figure).print_figure(part, format="png", dpi=DPI, metadata=about)
    return file
