"""Consistency of an estimator's covariance on various grounds, with GNSS outages.

A drive is recorded in closed loop with LQR. Sensors with other seeds then measure the same drive again: once without
outages, and once with two outages of each duration. A consistent filter has a mean NEES of 2 for the position and 1 for
the heading.
"""

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from recorded_drives import FULL, TILT, Day, End, RecordedDrive, Whole, end, follow, loss, record, whole

from agrobot_mj.core.signals import NOMINAL, Array

DURATION_S = 110.0  # Duration of a drive [s]
DRIVES, SEEDS = range(6, 11), range(200, 220)
"""Seeds of the recorded drives of a case, and seeds of the sensors. The filter settings were tuned with other seeds."""
LOSSES_S, LOSS_STARTS_S = (4.0, 11.0, 20.0), ((22.0, 46.0), (66.0, 90.0))
"""Durations of GNSS outages, and the intervals in which the two outages of a replay start [s]."""
SPACING_M, HALF_WIDTH_M = 0.5, 75.0  # Grid spacing and half width of the height maps [m]
Keys = dict[str, Any]


class GroundCase(NamedTuple):
    """Test case with a ground or a load. `overrides` is a function of the drive's seed and of a folder for height
    maps."""

    name: str
    scenario: str
    overrides: Callable[[int, Path], Keys]
    estimator: Keys


def _axis(half: float = HALF_WIDTH_M) -> Array:
    return np.arange(-half, half + SPACING_M / 2, SPACING_M)


def _heights(heights: Array, folder: Path, name: str) -> Keys:
    np.save(folder / name, heights)
    return {"kind": "heightmap", "file": str(folder / name), "spacing_m": SPACING_M}


def contour(seed: int, folder: Path, half: float = HALF_WIDTH_M) -> Keys:
    """Return overrides for a drive along the contour lines of a side slope of 12 to 25 deg.

    From 27 deg the unloaded upper rear wheel spins, and the open differential stops the compact tractor.
    """
    axis = _axis(half)
    heights = axis[:, None] * np.tan(np.radians(np.interp(axis, (37.0 - half, half - 35.0), (12.0, 25.0))))[None, :]
    path = {"kind": "line", "length_m": 2 * half - 10.0, "start_x_m": 7.0 - half}
    return {"terrain": _heights(heights, folder, f"contour{half:g}.npy"), "path": path}


def bowl(seed: int, folder: Path) -> Keys:
    """Return overrides for a figure eight on a slope of 12 to 20 deg. On 25 deg the wheels would slide."""
    grade = np.tan(np.radians(np.interp(_axis(), (-10.0, 10.0), (12.0, 20.0))))
    profile = np.concatenate([[0.0], np.cumsum((grade[1:] + grade[:-1]) / 2 * SPACING_M)])
    return {"terrain": _heights(np.repeat(profile[:, None], len(grade), 1), folder, "bowl.npy")}


def pulled(seed: int, folder: Path) -> Keys:
    """Return overrides for a drive on tilled soil with a drawbar pull of 600 to 1500 N in one interval."""
    rng = np.random.default_rng(seed)
    start, length, pull = (float(rng.uniform(*span)) for span in ((22.0, 66.0), (25.0, 44.0), (600.0, 1500.0)))
    fault = {"kind": "drawbar", "pull_n": pull, "noise_share": 0.2, "start_s": start, "end_s": start + length}
    return {"plant.tyre.kind": "soil", "plant.tyre.cone_index_kpa": 450, "fault": [fault]}


CASES = (
    GroundCase("level", "figure_eight", lambda *_: {}, FULL),
    GroundCase("side slope of a contour, 12 to 25 deg", "straight_line", contour, {**FULL, **TILT}),
    GroundCase("figure eight, slope 12 to 20 deg", "figure_eight", bowl, {**FULL, **TILT}),
    GroundCase("tilled soil, pull", "figure_eight", pulled, FULL),
    GroundCase("ruts", "figure_eight", lambda *_: {"plant.tyre.kind": "ruts"}, FULL),
    GroundCase(
        *("rough ground of class D", "figure_eight", lambda *_: {"terrain": {"kind": "rough", "iso_class": "D"}}),
        {**FULL, **TILT},
    ),
    GroundCase("trailer", "figure_eight", lambda *_: {"implement": {"kind": "drawn"}}, FULL),
)


def drive(case: GroundCase, seed: int, folder: Path, duration: float = DURATION_S, **more: Any) -> RecordedDrive:
    """Record a drive of a test case. The height map of the case remains in `folder` for the replays."""
    law = {"guidance": {"kind": "lqr"}, "estimator": case.estimator}
    return record(case.scenario, {**law, **case.overrides(seed, folder), "seed": seed, **more}, duration)


def losses(seed: int, seconds: float) -> tuple[Day, tuple[float, float]]:
    """Return conditions as a function of time with two GNSS outages of `seconds` [s], and the times at which the
    outages end [s]."""
    rng = np.random.default_rng((seed, round(seconds)))
    starts = [round(float(rng.uniform(*span)), 1) for span in LOSS_STARTS_S]
    one, other = (loss(start, seconds) for start in starts)
    return lambda t: one(t) if one(t) is not NOMINAL else other(t), (starts[0] + seconds, starts[1] + seconds)


class CaseErrors(NamedTuple):
    """Errors of an estimator in a test case, over all seeds."""

    wholes: list[Whole]
    losses: dict[float, list[list[End]]]  # Ends of outages by their duration [s], one list per seed


def judged(
    drives: Sequence[RecordedDrive], estimator: Keys, seeds: Sequence[int], lengths: Iterable[float] = LOSSES_S
) -> CaseErrors:
    """Return the errors of an estimator over all sensor seeds, without outages and with outages of `lengths` [s]."""
    found = CaseErrors([], {seconds: [] for seconds in lengths})
    for k, seed in enumerate(seeds):
        one = drives[k % len(drives)]
        found.wholes.append(whole(follow(one, estimator, seed)))
        for seconds, ends in found.losses.items():
            day, times = losses(seed, seconds)
            trace = follow(one, estimator, seed, day)
            ends.append([end(trace, time) for time in times])
    return found
