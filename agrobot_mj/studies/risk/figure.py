"""Figure of a risk: the chance to come so close, and the course of a run that failed beside one that did not."""

from collections.abc import Sequence
from math import floor, log10
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np

from agrobot_mj.core.palette import BLACK, BLUE
from agrobot_mj.core.signals import Array
from agrobot_mj.studies.courses import courses_figure
from agrobot_mj.studies.risk.splitting import Split
from agrobot_mj.studies.style import STYLE, save


def save_figure(splits: Sequence[Split], courses: Sequence[dict[str, Any]], file: Path) -> None:
    """Draw and save; thin lines are the splittings, the thick one their mean."""
    with mpl.rc_context(STYLE):
        drawn, chances, close = courses_figure(courses, ("a run", "a failure"))
        levels, mean = _mean(splits)
        for split in splits:
            chances.step(levels, _chances(split, levels), where="post", color=BLUE, linewidth=0.4)
        chances.step(levels, mean, where="post", color=BLACK)
        chances.axvline(0.0, color=BLACK, linewidth=0.6, linestyle="--")
        least = min((weight for split in splits for _, weight in split.trace if weight), default=0.1)
        chances.set(yscale="log", ylim=(0.7 * least, 1.4))
        chances.set(xlabel="closeness to the condition [-]", ylabel="chance of a run to come closer [-]")
        for power in range(1, 1 + floor(-log10(min(mean, default=1.0)))):
            level = levels[np.argmax(mean <= 10.0**-power)]
            close.axhline(level, color=BLUE, linewidth=0.4)
            close.text(0.0, level, f"1 in {10**power:,}", color=BLUE, fontsize=6, va="bottom")
        save(drawn, file)


def _mean(splits: Sequence[Split]) -> tuple[Array, Array]:
    """Levels of all splittings, and the mean chance to come above each, where it is above 0."""
    levels = np.unique([level for split in splits for level, _ in split.trace])
    mean = np.mean([_chances(split, levels) for split in splits], axis=0)
    return levels[mean > 0], mean[mean > 0]


def _chances(split: Split, levels: Array) -> Array:
    """Chance to come above each of some levels, by one splitting."""
    own, weights = np.array([(-np.inf, 1.0), *split.trace]).T
    return np.asarray(weights[np.searchsorted(own, levels, side="right") - 1])
