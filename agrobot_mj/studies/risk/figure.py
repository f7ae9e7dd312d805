"""Figure of a risk: the chance to come so close, and the course of a run that failed beside one that did not."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.figure import Figure

from agrobot_mj.core.palette import BLUE
from agrobot_mj.studies.courses import draw_courses
from agrobot_mj.studies.risk.splitting import Split
from agrobot_mj.studies.style import PANEL_WIDTH_IN, STYLE, save


def save_figure(splits: Sequence[Split], courses: Sequence[dict[str, Any]], file: Path) -> None:
    """Draw and save."""
    with mpl.rc_context(STYLE):
        drawn = Figure((2 * PANEL_WIDTH_IN, 2.4), layout="constrained")
        left, right = drawn.subplots(1, 2)
        for split in splits:
            levels, weights = zip(*[at for at in split.trace if at[1]] or [(0.0, 1.0)], strict=True)
            left.step(levels, weights, where="post", color=BLUE, linewidth=0.5)
        left.axvline(0.0, color="black", linewidth=0.6, linestyle="--")
        left.set(yscale="log", xlabel="closeness to the condition [-]", ylabel="chance of a run to come closer [-]")
        draw_courses(right, courses, ("a run", "a failure"))
        save(drawn, file)
