"""Whether `ekf_full` states its own errors where the ground changes, with losses of fixes.

A drive is recorded in a closed loop with LQR. Sensors with other seeds measure it again, without a loss and with two
losses of each length, whose beginnings the seed draws, so that a pull or a steeper piece may begin inside one. A
consistent filter has a NEES of 2 for the position and of 1 for the heading; intervals are those of the mean over seeds.
"""

from collections.abc import Callable, Iterator, Sequence
from math import degrees
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np
from estimates import estimate
from recorded_drives import BEGIN_S, FULL, TILT, Day, ErrorTrace, RecordedDrive, follow, nominal, record, rms

from agrobot_mj.core.markdown import markdown_table
from agrobot_mj.core.signals import NOMINAL, Array, Quality
from agrobot_mj.studies.statistics import bootstrap_interval

DURATION_S = 110.0
"""Length of a drive [s]."""
DRIVES, SEEDS = range(6, 11), range(200, 220)
"""Seeds of the recorded drives of a case, and of the sensors over them. Settings were chosen on others."""
LOSSES_S = (4.0, 11.0, 20.0)
"""Lengths of the losses [s]."""
LOSS_STARTS_S = ((22.0, 46.0), (66.0, 90.0))
"""Between which times [s] each of the two losses of a replay begins."""
SPACING_M, HALF_WIDTH_M = 0.5, 75.0
"""Spacing of the height maps [m], and half of their width [m]."""
AXIS = np.arange(-HALF_WIDTH_M, HALF_WIDTH_M + SPACING_M / 2, SPACING_M)

Keys = dict[str, Any]


class GroundCase(NamedTuple):
    """A ground or load on which the filter is judged.

    `overrides` of the scenario follow from the seed of the drive and the folder into which height maps are written.
    """

    name: str
    scenario: str
    overrides: Callable[[int, Path], Keys]
    estimator: Keys


def _rising(places: tuple[float, float], angles_deg: tuple[float, float]) -> Array:
    """Tangent along `AXIS` of a slope that rises from one angle to another between two places [-]."""
    return np.asarray(np.tan(np.radians(np.interp(AXIS, places, angles_deg))))


def _heights(heights: Array, folder: Path, name: str) -> Keys:
    """A terrain of these heights."""
    np.save(folder / name, heights)
    return {"kind": "heightmap", "file": str(folder / name), "spacing_m": SPACING_M}


def contour(seed: int, folder: Path, half: float = HALF_WIDTH_M) -> Keys:
    """Along a contour line whose side slope rises from 12 to 28 deg; at 31 deg the tractor slides off."""
    axis = np.arange(-half, half + SPACING_M / 2, SPACING_M)
    heights = axis[:, None] * np.tan(np.radians(np.interp(axis, (37.0 - half, half - 35.0), (12.0, 28.0))))[None, :]
    path = {"kind": "line", "length_m": 2 * half - 10.0, "start_x_m": 7.0 - half}
    return {"terrain": _heights(heights, folder, f"contour{half:g}.npy"), "path": path}


def bowl(seed: int, folder: Path) -> Keys:
    """A figure eight across a slope that rises from 12 to 20 deg; from 25 deg on its wheels slide."""
    grade = _rising((-10.0, 10.0), (12.0, 20.0))
    profile = np.concatenate([[0.0], np.cumsum((grade[1:] + grade[:-1]) / 2 * SPACING_M)])
    return {"terrain": _heights(np.repeat(profile[:, None], len(AXIS), 1), folder, "bowl.npy")}


def pulled(seed: int, folder: Path) -> Keys:
    """Tilled soil, and a pull of 600 to 1500 N that begins and ends once."""
    rng = np.random.default_rng(seed)
    start, length, pull = (float(rng.uniform(*span)) for span in ((22.0, 66.0), (25.0, 44.0), (600.0, 1500.0)))
    fault = {"kind": "drawbar", "pull_n": pull, "noise_share": 0.2, "start_s": start, "end_s": start + length}
    return {"plant.tyre.kind": "soil", "plant.tyre.cone_index_kpa": 450, "fault": [fault]}


ROUGH = {"terrain": {"kind": "rough", "iso_class": "D"}}

CASES = (
    GroundCase("level", "figure_eight", lambda seed, folder: {}, FULL),
    GroundCase("side slope of a contour, 12 to 28 deg", "straight_line", contour, {**FULL, **TILT}),
    GroundCase("figure eight, slope 12 to 20 deg", "figure_eight", bowl, {**FULL, **TILT}),
    GroundCase("tilled soil, pull", "figure_eight", pulled, FULL),
    GroundCase("ruts", "figure_eight", lambda seed, folder: {"plant.tyre.kind": "ruts"}, FULL),
    GroundCase("rough ground of class D", "figure_eight", lambda seed, folder: ROUGH, {**FULL, **TILT}),
    GroundCase("trailer", "figure_eight", lambda seed, folder: {"implement": {"kind": "drawn"}}, FULL),
)


def drive(case: GroundCase, seed: int, folder: Path, duration: float = DURATION_S) -> RecordedDrive:
    """The truth of a case driven with a seed; its height map stays in the folder, where replays look for it."""
    law = {"guidance": {"kind": "lqr"}, "estimator": case.estimator}
    return record(case.scenario, {**law, **case.overrides(seed, folder), "seed": seed}, duration)


def losses(seed: int, seconds: float) -> tuple[Day, tuple[float, float]]:
    """A day with two losses, and when they end [s]."""
    rng = np.random.default_rng((seed, round(seconds)))
    starts = [round(float(rng.uniform(*span)), 1) for span in LOSS_STARTS_S]
    lost = NOMINAL._replace(gnss_quality=Quality.NONE)

    def day(t: float) -> Any:
        return lost if any(start <= t + 1e-6 < start + seconds for start in starts) else NOMINAL

    return day, (starts[0] + seconds, starts[1] + seconds)


class Whole(NamedTuple):
    """A replay without a loss, after `BEGIN_S`: rms of position [cm] and heading [deg], means of NEES and NIS [-]."""

    position: float
    heading: float
    nees: float
    heading_nees: float
    nis: float


class End(NamedTuple):
    """The last tick of a loss: error of R and its stated standard deviation, both axes together [cm], and NEES [-]."""

    position: float
    stated: float
    nees: float
    heading_nees: float


def whole(trace: ErrorTrace) -> Whole:
    """What a replay without a loss comes to."""
    counts = trace.t > BEGIN_S
    nees, heading_nees = (float(np.mean(values[counts])) for values in (trace.nees, trace.heading_nees))
    off = 100 * rms(trace.position[counts]), degrees(rms(trace.heading[counts]))
    return Whole(*off, nees, heading_nees, float(np.nanmean(trace.nis[counts])))


def end(trace: ErrorTrace, time: float) -> End:
    """The last tick of a loss that ends at a time [s]."""
    k = int(np.flatnonzero(trace.t < time - 1e-6)[-1])
    return End(*map(float, (100 * trace.position[k], 100 * trace.sigma[k], trace.nees[k], trace.heading_nees[k])))


class CaseErrors(NamedTuple):
    """A case over all seeds."""

    wholes: list[Whole]
    losses: dict[float, list[list[End]]]  # ends of the losses of each length [s], those of a seed together


def judged(drives: Sequence[RecordedDrive], estimator: Keys, seeds: Sequence[int]) -> CaseErrors:
    """An estimator on drives, measured with these seeds in turn."""
    found = CaseErrors([], {seconds: [] for seconds in LOSSES_S})
    for k, seed in enumerate(seeds):
        one = drives[k % len(drives)]
        found.wholes.append(whole(follow(one, estimator, seed, nominal)))
        for seconds in LOSSES_S:
            day, times = losses(seed, seconds)
            trace = follow(one, estimator, seed, day)
            found.losses[seconds].append([end(trace, time) for time in times])
    return found


SPEEDS_M_S, MACHINES = (0.8, 1.2, 2.2, 3.0), {"compact": 1.0, "utility": 6.7, "row_crop": 12.5}
"""Speeds of the second table, and its machines, each with its mass over that of the compact tractor."""
LOSS_S, SPEED_SEEDS = 11.0, SEEDS[:4]
"""Length of the losses of that table [s], and its seeds of the sensors."""


def drive_at(case: GroundCase, machine: str, speed: float, folder: Path) -> RecordedDrive:
    """The truth of a case driven by a machine at a speed [m/s], with the fast physics."""
    keys: Keys = {"guidance": {"kind": "lqr"}, "estimator": case.estimator, "physics": "fast", "seed": DRIVES[0]}
    if machine != "compact":
        keys["machine"] = machine
    ground = case.overrides(DRIVES[0], folder)
    for fault in ground.get("fault", ()):
        fault["pull_n"] *= MACHINES[machine]
    if case.scenario == "straight_line":
        ground = contour(DRIVES[0], folder, max(HALF_WIDTH_M, 37.0 + DURATION_S * speed / 2.0))
    else:
        ground["path.turns"] = 1 + round(speed)
    return record(case.scenario, {**keys, **ground, "path.speed_m_s": speed}, DURATION_S)


def cell(job: tuple[int, str, float]) -> dict[str, str]:
    """NEES of position and heading, and error and sigma at the end of losses, of a case, machine and speed [m/s]."""
    index, machine, speed = job
    case, wholes, ends = CASES[index], list[Whole](), list[End]()
    with TemporaryDirectory() as folder:
        one = drive_at(case, machine, speed, Path(folder))
        for seed in SPEED_SEEDS:
            wholes.append(whole(follow(one, case.estimator, seed, nominal)))
            day, times = losses(seed, LOSS_S)
            trace = follow(one, case.estimator, seed, day)
            ends += [end(trace, time) for time in times]
    nees, heading_nees = (_mean([getattr(w, name) for w in wholes]) for name in ("nees", "heading_nees"))
    off, stated = (rms(np.array([getattr(e, name) for e in ends])) for name in ("position", "stated"))
    return {"nees": nees, "heading": heading_nees, "loss": f"{off:.0f} / {stated:.0f}"}


ROWS = [(index, machine) for index in range(len(CASES)) for machine in MACHINES]
"""Cases and machines of the second table."""
CELLS = [(*row, speed) for row in ROWS for speed in SPEEDS_M_S]
"""Its cells, row by row."""


def speed_table(cells: Sequence[Keys], name: str) -> str:
    """One number of all `CELLS` as Markdown."""
    left = iter(cells)
    rows = [(CASES[index].name, machine, *(next(left)[name] for _ in SPEEDS_M_S)) for index, machine in ROWS]
    return markdown_table(("case", "machine", *(f"{speed:g} m/s" for speed in SPEEDS_M_S)), rows, 2)


def _mean(values: Sequence[float]) -> str:
    return estimate(values, bootstrap_interval).text()


WHOLE_HEADS = ("case", "position [cm]", "heading [deg]", "NEES", "heading NEES", "NIS")
LOSS_HEADS = ("case", "loss", "rms [cm]", "worst [cm]", "stated [cm]", "NEES", "heading NEES")


def whole_row(name: str, found: CaseErrors) -> tuple[str, ...]:
    """Cells of `WHOLE_HEADS`, of replays without a loss."""
    position, heading, nees, heading_nees, nis = zip(*found.wholes, strict=True)
    numbers = (f"{np.mean(position):.2f}", f"{np.mean(heading):.3f}", _mean(nees), _mean(heading_nees))
    return name, *numbers, f"{np.mean(nis):.2f}"


def loss_rows(name: str, found: CaseErrors) -> Iterator[tuple[str, ...]]:
    """Cells of `LOSS_HEADS`, a row for each length."""
    for seconds, seeds in found.losses.items():
        every = np.array([end for some in seeds for end in some])
        nees, heading_nees = np.array(seeds)[:, :, 2:].mean(axis=1).T
        numbers = (rms(every[:, 0]), every[:, 0].max(), rms(every[:, 1]))
        yield name, f"{seconds:g} s", *(f"{v:.1f}" for v in numbers), _mean(nees), _mean(heading_nees)


def consistency_tables(drives: Sequence[int] = DRIVES, seeds: Sequence[int] = SEEDS) -> tuple[str, str]:
    """The tables of replays without a loss, and of losses, as Markdown."""
    wholes, lost = [], list[tuple[str, ...]]()
    with TemporaryDirectory() as folder:
        for case in CASES:
            found = judged([drive(case, seed, Path(folder)) for seed in drives], case.estimator, seeds)
            wholes.append(whole_row(case.name, found))
            lost += loss_rows(case.name, found)
    return markdown_table(WHOLE_HEADS, wholes, 1), markdown_table(LOSS_HEADS, lost, 2)
