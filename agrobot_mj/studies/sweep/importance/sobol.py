"""Sobol indices [Saltelli2010] of a sweep of `method = "saltelli"`, by SALib.

The first-order index of a draw is the share of a metric's variance that goes away once its value is known; the total
index is the share that stays while only it is unknown, interactions included. The sum of first-order indices is at most
1, and a total index near 0 means that the number may stay an estimate. Intervals are by bootstrap.
"""

from collections.abc import Sequence

import numpy as np
from scipy.stats import norm, t

from agrobot_mj.core.extras import required
from agrobot_mj.core.signals import Array
from agrobot_mj.studies.sweep.importance.shares import CONFIDENCE, Share

RESAMPLES = 1000
"""Resamples of the bootstrap [-]."""
FEWEST = 64
"""Fewest samples whose intervals are trusted; those of 16 miss known indices in a third of all cases and more."""


def sobol_shares(keys: Sequence[str], values: Array, noise: float) -> list[Share]:
    """The indices of values in the order of the design, shape (n (d + 2),). Raises `ScenarioError` without SALib.

    `noise` is its share of the variance of `values`. It is in each total index, and taken from estimate and lower end;
    the upper end keeps it, since noise that depends on a draw is not in the others.
    """
    sobol, d = required("SALib.analyze.sobol", "studies", "importance"), len(keys)
    problem = {"num_vars": d, "names": list(keys), "bounds": [[0.0, 1.0]] * d}
    found = sobol.analyze(problem, values, calc_second_order=False, num_resamples=RESAMPLES, seed=1)
    # SALib's half widths are those of a normal distribution for one index alone; these hold for all at once.
    widen = t.ppf(1.0 - (1.0 - CONFIDENCE) / (2 * d), max(len(values) // (d + 2) - 1, 1)) / norm.ppf(0.975)
    columns = np.column_stack([found["ST"], widen * found["ST_conf"], found["S1"], widen * found["S1_conf"]])
    real = max(1.0 - noise, 1e-6)
    return [
        Share(
            key,
            share=float((total - noise) / real),
            low=float(min(total - half - noise, (total - half - noise) / real)),
            high=float((total + half) / real),
            effect=float(first / real),
            half=float(first_half / real),
        )
        for key, (total, half, first, first_half) in zip(keys, columns, strict=True)
    ]


def sobol_flaws(shares: Sequence[Share], samples: int) -> tuple[str, ...]:
    """Why the intervals cannot be trusted: too few samples, or values that no index can have."""
    few = [f"{samples} samples are too few for intervals; {FEWEST} or more tell"] if samples < FEWEST else []
    return (*few, *(f"{text}: no index can be there" for share in shares for text in _impossible(share)))


def _impossible(share: Share) -> list[str]:
    """Intervals that exclude everything from 0 to 1."""
    ends = {"first-order": (share.effect - share.half, share.effect + share.half), "total": (share.low, share.high)}
    return [
        f"{share.key}: the {name} index is from {low:.2f} to {high:.2f}"
        for name, (low, high) in ends.items()
        if high < 0.0 or low > 1.0
    ]
