"""The numbers of a run: pure functions of its log.

Lengths in metres, angles in radians; `mse` in m2. Rows whose value is absent or not finite are left out of
the statistic concerned; a statistic without a single value is None, so that the result is always valid JSON.

`lateral_*` and `longitudinal_*` are the time-based errors of the paper; `xte_*` is the cross-track error, the
distance of the CG from the path itself, whatever the time (`crosstrack`). A path with passes also has the accuracy
from pass to pass (`passes`).

A row of the log belongs to the turn with start < t <= end (the first turn also owns its start). A run that
ends early lacks the turns it did not reach; the turn in which it ended counts as far as it went and is not
`complete`.
"""

from math import isfinite
from typing import Any, Protocol

import numpy as np

from agrobot_mj.core.signals import Array
from agrobot_mj.metrics.crosstrack import BesidePath, track
from agrobot_mj.metrics.passes import pass_to_pass
from agrobot_mj.paths import Parallel, Path

RowMask = np.ndarray[tuple[int, ...], np.dtype[np.bool_]]

COMPLETE = 0.99
"""Share of a turn that a run must cover for the turn to count as complete."""


class HasPath(Protocol):
    """The part of a scenario that the metrics need."""

    @property
    def path(self) -> Path:
        """The reference path."""
        ...


class LogLike(Protocol):
    """The part of a log that the metrics and the figures need."""

    @property
    def scenario(self) -> HasPath:
        """The scenario that was run."""
        ...

    def column(self, name: str) -> Array:
        """One signal, shape (ticks,), NaN where absent."""
        ...


def metrics(log: LogLike, outcome: str | None = None) -> dict[str, Any]:
    """All metrics of a run, ready for JSON, with `outcome` in front if it is given."""
    beside, turns = track_of(log), _turns(log)
    t, ends, xte = log.column("t"), log.scenario.path.turns_s, beside.offset
    return {
        **({} if outcome is None else {"outcome": outcome}),
        **_errors(log, xte, np.ones(len(xte), dtype=bool)),
        "per_turn": [
            {"turn": k + 1, "complete": _covers(t, *ends[k]), **_errors(log, xte, rows)} for k, rows in enumerate(turns)
        ],
        "nn_share": [nn_share(log, rows) for rows in turns],
        "position_nees": _mean(log.column("position_nees")),
        "position_nis": _mean(log.column("position_nis")),
        "steer_saturated_fraction": _mean(log.column("steer_saturated")),
    } | _of_passes(log, beside)


def _of_passes(log: LogLike, beside: BesidePath) -> dict[str, Any]:
    """The accuracy from pass to pass, where the path has passes."""
    path = log.scenario.path
    if not isinstance(path, Parallel):
        return {}
    return {"iso_12188_2_style": pass_to_pass(path, beside.time, log.column("x"), log.column("y"))}


def errors(log: LogLike, start_s: float = -np.inf, end_s: float = np.inf) -> dict[str, float | None]:
    """The tracking errors over the rows with start_s < t <= end_s [s]."""
    t = log.column("t")
    return _errors(log, track_of(log).offset, (t > start_s) & (t <= end_s))


def nn_share(log: LogLike, rows: RowMask) -> float:
    """Share of the network in the command: mean|tau_n| / (mean|tau_c| + mean|tau_n|), 0 without a network.

    `rows` is a mask of shape (ticks,).
    """
    tau_c = _mean(np.abs(log.column("tau_c")[rows])) or 0.0
    tau_n = _mean(np.abs(log.column("tau_n")[rows])) or 0.0
    return tau_n / (tau_c + tau_n) if tau_n else 0.0


def track_of(log: LogLike) -> BesidePath:
    """Where the true CG is beside the path at each tick."""
    return track(log.scenario.path, log.column("t"), log.column("x"), log.column("y"))


def _errors(log: LogLike, xte: Array, rows: RowMask) -> dict[str, float | None]:
    lateral, longitudinal = log.column("e_lateral")[rows], log.column("e_longitudinal")[rows]
    return {
        "lateral_mse": _mean(lateral, 2),
        "lateral_rms": _rms(lateral),
        "lateral_abs_p95": _abs_p95(lateral),
        "longitudinal_rms": _rms(longitudinal),
        "xte_rms": _rms(xte[rows]),
        "xte_abs_p95": _abs_p95(xte[rows]),
        "yaw_rate_error_rms": _rms(log.column("e_yaw_rate")[rows]),
    }


def _turns(log: LogLike) -> list[RowMask]:
    """For each turn that the run reached the rows that belong to it, as a mask of shape (ticks,)."""
    t, turns = log.column("t"), log.scenario.path.turns_s
    rows = [(t > start) & (t <= end) | (t == start) & (k == 0) for k, (start, end) in enumerate(turns)]
    return [of_turn for of_turn in rows if of_turn.any()]


def _covers(t: Array, start: float, end: float) -> bool:
    return bool(t[-1] - start >= COMPLETE * (end - start))


def _mean(values: Array, power: int = 1) -> float | None:
    """Mean of the finite values to a power, or None without any (or beyond the range of a float)."""
    with np.errstate(over="ignore"):
        terms = values[np.isfinite(values)] ** power
        mean = float(np.mean(terms)) if terms.size else np.nan
    return mean if isfinite(mean) else None


def _rms(values: Array) -> float | None:
    mean_square = _mean(values, 2)
    return None if mean_square is None else mean_square**0.5


def _abs_p95(values: Array) -> float | None:
    finite = np.abs(values[np.isfinite(values)])
    return float(np.percentile(finite, 95)) if finite.size else None
