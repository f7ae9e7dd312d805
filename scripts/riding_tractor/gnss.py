"""How the riding tractor's receivers fail: qualities, losses and silences in its logs, and how far it went on."""

from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np

from agrobot_mj.core.geodesy import Origin, local_points
from agrobot_mj.core.markdown import markdown_table
from agrobot_mj.core.signals import Array
from agrobot_mj.extensions.logs.pieces import spells
from riding_tractor.closed_loop import Loop
from riding_tractor.logs import CALIBRATION, COVERAGE, HELD_OUT, STANDING, FieldLog, Repository, field_log, pursuit_log

DGPS = 2.0
SILENT_S = 5.0
"""Time without any change in a receiver's columns from which it counts as silent [s]: noise changes them within one."""
DRIVING_M_S, RESTING_M_S = 0.3, 0.05
"""Speeds above which it drives and below which it rests [m/s]."""


class Spell(NamedTuple):
    """A stretch of a log."""

    log: str
    start: float  # time since the log's first row [s]
    lasts: float  # duration [s]
    fixed: float  # share of the time in which the log says that the carrier phase is fixed [-]
    valid: float  # share of the time in which it says that the heading is valid [-]


def stretches(name: str, log: FieldLog, mask: np.ndarray, least: float = 0.0) -> list[Spell]:
    """Stretches of a log in which a condition holds, of at least so many seconds."""
    found = []
    for a, b in spells(mask):
        end = min(b, len(log.t) - 1)
        lasts = float(log.t[end] - log.t[a])
        if lasts >= least:
            shares = (float(column[a:b].mean()) for column in (log.carrier, log.valid))
            found.append(Spell(name, float(log.t[a] - log.t[0]), lasts, *shares))
    return found


def silences(name: str, log: FieldLog, changed: Array) -> list[Spell]:
    """Stretches in which a receiver says nothing new though its flags stand."""
    return stretches(name, log, changed == 0.0, SILENT_S)


class Stop(NamedTuple):
    """A stop of the tractor by its own gate, which asks for an RTK fix and a valid heading."""

    log: str
    reason: str
    speed: float  # speed when it began [m/s]
    way: float  # way until it rested [m]


def stops(repository: Repository) -> list[Stop]:
    """Stops by the gate while the guidance drove, from a speed to rest."""
    found = []
    for run in (*CALIBRATION, *HELD_OUT):
        log, guidance = field_log(repository, run), pursuit_log(repository, run)
        for a, _ in spells(guidance.driving == 0.0):
            k = int(np.searchsorted(log.t, guidance.t[a]))
            if not 0 < k < len(log.t) or not log.auto[k] or log.speed[k] < DRIVING_M_S:
                continue
            resting = np.flatnonzero(log.speed[k:] < RESTING_M_S)
            end = k + int(resting[0]) if resting.size else len(log.t) - 1
            again = np.flatnonzero(guidance.driving[a:] > 0.0)
            if again.size and guidance.t[a + int(again[0])] < log.t[end] - 0.5:
                continue  # it drove on before it had come to rest
            way = float(np.sum(log.speed[k:end] * np.diff(log.t[k : end + 1])))
            found.append(Stop(run.name, guidance.reason[a], float(log.speed[k]), way))
    return found


def wander(log: FieldLog) -> float:
    """Largest distance of positions of quality 2 from the mean of the fixed ones, of a tractor at rest [m]."""
    there = np.isfinite(log.latitude)
    origin = Origin(float(log.latitude[there][0]), float(log.longitude[there][0]))
    places = local_points(origin, log.latitude[there], log.longitude[there])
    fixed, loose = log.quality[there] == 4.0, log.quality[there] == DGPS
    if not (fixed.any() and loose.any()):
        return 0.0
    return float(np.hypot(*(places[loose] - places[fixed].mean(axis=0)).T).max())


def spread(values: Sequence[float]) -> str:
    """Median, the value that one in twenty exceeds, and the largest."""
    return f"{np.median(values):.1f} / {np.percentile(values, 95):.1f} / {max(values):.1f}" if values else "-"


def failures(repository: Repository) -> str:
    """A line for each way to fail: how often, how long, and what the flags say meanwhile."""
    driving = [(run.name, field_log(repository, run)) for run in (COVERAGE, *CALIBRATION, *HELD_OUT)]
    standing = [(run.name, field_log(repository, run)) for run in STANDING]
    groups: dict[str, Iterable[Spell]] = {
        "driving: quality 2": [s for name, log in driving for s in stretches(name, log, log.quality == DGPS)],
        "driving: heading not valid": [s for name, log in driving for s in stretches(name, log, log.valid == 0.0)],
        "at rest: quality 2": [s for name, log in standing for s in stretches(name, log, log.quality == DGPS)],
        "at rest: position, speed and age of corrections stand still": [
            s for name, log in standing for s in silences(name, log, log.receiver)
        ],
        "at rest: heading stands still": [s for name, log in standing for s in silences(name, log, log.antennas)],
    }
    lines = []
    for title, some in groups.items():
        time = np.array([s.lasts for s in some])
        shares = (
            f"{np.average([getattr(s, key) for s in some], weights=time):.0%}" if len(time) else "-"
            for key in ("fixed", "valid")
        )
        lines.append((title, len(time), spread(time.tolist()), *shares))
    heads = ("what", "times", "lasts: median / 95 % / longest [s]", 'says carrier "fixed"', "says heading valid")
    return markdown_table(heads, lines)


def stops_table(repository: Repository) -> str:
    """Stops by the gate."""
    lines = [(s.log, s.reason.split(" below")[0], f"{s.speed:.2f}", f"{s.way:.2f}") for s in stops(repository)]
    return markdown_table(("run", "gate closed for", "from [m/s]", "way to rest [m]"), lines)


BEGIN_S, LINE_M, SPEED_M_S = 20.0, 56.0, 0.5
"""Time at which a failure begins on the twin [s], length of its line [m] and its speed [m/s]."""
OPEN_LOOP = {"speed.outer.kp": 0.0, "speed.outer.ki": 0.0}
"""Keys of a drive that is a position of its lever, as the owner's; a loop would race after a frozen speed."""
AFTER_S = 2.0
"""Time after the end of a failure that counts [s]."""
FAILURES: dict[str, dict[str, Any]] = {
    "position silent for 37 s, last fix RTK": {"kind": "gnss_frozen", "keep": "velocity", "end_s": BEGIN_S + 37},
    "position silent for 37 s, last fix of quality 2": {
        "kind": "gnss_frozen",
        "keep": "velocity",
        "quality": "dgps",
        "end_s": BEGIN_S + 37,
    },
    "heading silent from then on, called valid": {"kind": "heading_stuck"},
    "quality 2 for 1.4 s": {"kind": "gnss_dgps", "end_s": BEGIN_S + 1.4},
    "quality 2 for 7.2 s": {"kind": "gnss_dgps", "end_s": BEGIN_S + 7.2},
    "no heading for 0.2 s": {"kind": "heading_loss", "end_s": BEGIN_S + 0.2},
    "no heading for 3.4 s": {"kind": "heading_loss", "end_s": BEGIN_S + 3.4},
}
"""Failures as the logs have them: median and longest."""


def on_the_twin(loop: Loop, ground: dict[str, Any], seeds: Sequence[int]) -> str:
    """What the owner's gate does about each failure: way to rest, and how far off the line it gets."""
    open_loop = {**OPEN_LOOP, "speed.feedforward_s_m": 1.0 / loop.twin.driveline.full_speed_m_s}
    loop, lines = loop._replace(twin=loop.twin.changed(open_loop)), []
    for name, keys in FAILURES.items():
        ways, offs = [], []
        for seed in seeds:
            fault = {"start_s": BEGIN_S, **keys}
            rows = loop.run(SPEED_M_S, seed, ground, (fault,), LINE_M).rows
            after = rows[:, (rows[0] >= BEGIN_S) & (rows[0] < keys.get("end_s", rows[0][-1]) + AFTER_S)]
            rests = np.flatnonzero(after[6] < RESTING_M_S)
            end = int(rests[0]) if rests.size else None
            ways.append(float(after[4][end] - after[4][0]) if end is not None else None)
            offs.append(float(np.abs(after[5] - rows[5][rows[0] < BEGIN_S][-1]).max()))
        stopped = [way for way in ways if way is not None]
        text = f"{np.mean(stopped):.2f} ({max(stopped):.2f})" if stopped else "drives on"
        lines.append((name, f"{len(stopped)} of {len(ways)}", text, f"{np.mean(offs):.2f} ({max(offs):.2f})"))
    heads = ("failure", "stops", "way to rest [m]", "off its line [m]")
    return markdown_table(heads, lines)
