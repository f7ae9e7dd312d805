"""Fit of scenario keys to logs with MuJoCo's toolbox `mujoco.sysid` (extra `sysid`), by replays on the plant.

Any key with a nonzero number can be fitted: tyre, mass, geometry, soil. Residuals are errors of yaw rate and position
in windows. A rigid motion aligns each window with the recording, so that residuals do not depend on the initial pose.
The toolbox assumes independent errors of equal size, but errors of logs are correlated. Therefore the intervals come
from a jackknife over windows. Errors of the map are equal in all windows. Therefore the variances due to typical errors
of a calibrated wheel angle are added. The intervals do not include errors of other keys.
"""

from collections.abc import Mapping, Sequence
from copy import copy
from io import StringIO
from math import inf
from typing import Any, NamedTuple

import numpy as np

from agrobot_mj.core.errors import ScenarioError, import_extra, suggestion
from agrobot_mj.core.signals import Array
from agrobot_mj.core.table_columns import FieldLogError, Source
from agrobot_mj.extensions.logs.identify.vehicle import LEAST_WINDOWS, SEPARABLE
from agrobot_mj.extensions.logs.identify.windows import TooLittleError
from agrobot_mj.extensions.logs.maps import LogMap
from agrobot_mj.extensions.logs.pieces import read_pieces
from agrobot_mj.extensions.logs.quantities import Quantity, half_width
from agrobot_mj.extensions.logs.recording import FieldRecording
from agrobot_mj.extensions.logs.replay.driving import Driven, drive
from agrobot_mj.extensions.logs.replay.residuals import WINDOW_S, beside, moving, start_pose, windows
from agrobot_mj.extensions.logs.replay.result import on_wide_ground, reach
from agrobot_mj.extensions.logs.series import TimeSeries
from agrobot_mj.scenario.overrides import flat
from agrobot_mj.scenario.schema import Scenario

RANGE = 4.0  # Maximum ratio between a fitted value and its initial value, in both directions [-]
STEP = 0.01  # Relative change of a value for finite differences [-]: large compared with contact noise
STEER_SCALE, STEER_DELAY_S = 0.005, 0.002
"""Standard deviations of the relative scale error [-] and of the latency error [s] of the recorded wheel angle. Assumed
values for a calibrated map. An error of 2 ms changes a rear stiffness by 3 %."""
Residuals = dict[tuple[str, int, int], Array]
"""Residuals by channel, segment and window number. The number of residuals is independent of the fitted keys."""


class FittedKeys(NamedTuple):
    """Result of a fit of scenario keys to logs."""

    found: dict[str, Quantity]  # Fitted values by scenario key, with intervals from a jackknife over windows
    toolbox: dict[str, float]  # Half widths of the intervals that MuJoCo's toolbox computes, by scenario key
    windows: int
    rms: dict[str, tuple[float, float]]
    """RMS residual of each channel with the initial values and with the fitted values [rad/s or m]."""
    notes: tuple[str, ...]


class _Problem:
    """Least-squares problem with residuals from replays. Unknowns are key values divided by their initial values."""

    def __init__(self, pieces: Sequence[FieldRecording], scenario: Scenario, start: Mapping[str, float]) -> None:
        self.scenario, self.start = on_wide_ground(scenario, max(map(reach, pieces))), start
        self.pieces = [(each, start_pose(each, scenario.tractor.wheelbase_m)) for each in pieces]
        self.weights: dict[str, float] = {}

    def with_misreading(self, scale: float, delay: float) -> "_Problem":
        """Return a copy of the problem with a relative scale error and a latency error [s] of the wheel angles."""
        other = copy(self)
        other.pieces = [
            (each._replace(steer=each.steer and TimeSeries(each.steer.t + delay, (1 + scale) * each.steer.value)), pose)
            for each, pose in self.pieces
        ]
        return other

    def residuals(self, x: Array) -> Residuals:
        """Return the unweighted residuals of replays with the unknowns `x`."""
        values = (x * list(self.start.values())).tolist()
        scenario = self.scenario.changed(dict(zip(self.start, values, strict=True)))
        found = Residuals()
        for k, (piece, pose) in enumerate(self.pieces):
            found |= _residuals(k, piece, drive(scenario, piece, pose))
        return found

    def weighted_residuals(self, x: Array, _: Any = None) -> tuple[list[Array], None, None]:
        """Return weighted residuals (samples, points) for unknowns `x` (n, points), in the format of `mujoco.sysid`."""
        points = [self.residuals(each) for each in np.reshape(x, (len(self.start), -1)).T]
        rows = {key: np.stack([each[key] for each in points], axis=1) for key in points[0]}
        return [each / self.weights[name] for (name, *_), each in rows.items()], None, None


def fit_keys(
    source: Source | Sequence[Source],
    log_map: LogMap | None,
    scenario: Scenario,
    names: Sequence[str],
    start_s: float = 0.0,
    end_s: float = inf,
) -> FittedKeys:
    """Fit the scenario keys `names` to logs, starting from the values of `scenario`. Raises `FieldLogError` for an
    unsuitable log, `ScenarioError` for an invalid key."""
    import_extra("absl", "sysid", "a fit of scenario keys")
    toolbox = import_extra("mujoco.sysid", "sysid", "a fit of scenario keys")
    start = start_values(scenario, names)
    cut = read_pieces(source, log_map, scenario.tractor.antenna_height_m, start_s, end_s)
    problem, x = _Problem(cut.kept, scenario, start), np.array([1.0] * len(start))
    first = now = problem.residuals(x)
    if (number := len({key[1:] for key in first})) < LEAST_WINDOWS:
        raise TooLittleError(
            f"{cut.kept[0].name}: the log has {number} windows of {WINDOW_S:g} s, but a fit needs "
            f"{LEAST_WINDOWS}; use a longer log"
        )
    for _ in range(2):  # the second round has the weights of the first optimum
        problem.weights = _rms(now)
        x, jacobian = _optimum(toolbox, problem, x)
        now = problem.residuals(x)
    rows = [row[:, 0] for row in problem.weighted_residuals(x)[0]]
    scale = np.diag(list(start.values()))
    halves = np.abs(scale) @ toolbox.calculate_intervals(rows, jacobian)[1]
    covariance = _jackknife_covariance(now, rows, jacobian)
    for error in ((STEER_SCALE, 0.0), (0.0, STEER_DELAY_S)):
        misread = problem.with_misreading(*error).weighted_residuals(x)[0]
        effect = np.linalg.pinv(jacobian) @ np.concatenate(
            [other[:, 0] - row for other, row in zip(misread, rows, strict=True)]
        )
        covariance += np.outer(effect, effect)
    found, notes = dict[str, Quantity](), list(cut.notes)
    for name, factor, unit in zip(start, x, scale, strict=True):
        value, half = float(factor) * start[name], half_width(covariance, unit, number - 1)
        found[name] = Quantity(value, value - half, value + half, half < SEPARABLE * abs(value))
        if not 1.02 / RANGE < factor < RANGE / 1.02:
            notes.append(
                f"{name}: the fit ends at its limit of {factor:.2g} times the start value; set another start value "
                f"with --set {name}"
            )
    rms = {name: (before, _rms(now)[name]) for name, before in _rms(first).items()}
    return FittedKeys(found, dict(zip(start, halves.tolist(), strict=True)), number, rms, tuple(notes))


def start_values(scenario: Scenario, names: Sequence[str]) -> dict[str, float]:
    """Return the values of the scenario keys `names`. Raises `ScenarioError` if a value is zero or not a number."""
    known = {name: float(each) for name, each in flat(scenario.model_dump()) if isinstance(each, int | float)}
    if key := next((name for name in names if not known.get(name)), ""):
        near = suggestion(key, list(known)) if key not in known else ""
        raise ScenarioError(f"--fit {key}: must be a scenario key with a nonzero number as start value{near}")
    return {name: known[name] for name in names}


def _residuals(number: int, piece: FieldRecording, driven: Driven) -> Residuals:
    """Return the residuals of one replayed segment. Raises `FieldLogError` if the replay ended early."""
    if driven.outcome != "completed":
        raise FieldLogError(
            f"{piece.name}: the simulation of the plant ended early ({driven.outcome}); omit this part of the log with "
            "--from and --to"
        )
    found = Residuals()
    fixes, model = beside(piece, driven)
    for k, inside, laid in windows(fixes, model, driven.t[0]):
        found["position", number, k] = (laid - fixes.value[inside]).ravel()
    if piece.yaw_rate is not None:
        t, seen = moving(piece, piece.yaw_rate.between(driven.t[0], driven.t[-1]))
        off, window = np.interp(t, driven.t, driven.yaw_rate) - seen, (t - driven.t[0]) // WINDOW_S
        found |= {("yaw_rate", number, int(k)): off[window == k] - off.mean() for k in np.unique(window)}
    return found


def _rms(residuals: Residuals) -> dict[str, float]:
    parts = {name: [each for key, each in residuals.items() if key[0] == name] for name, *_ in residuals}
    return {name: float(np.sqrt(np.mean(np.concatenate(each) ** 2))) for name, each in parts.items()}


def _optimum(toolbox: Any, problem: _Problem, x: Array) -> tuple[Array, Array]:
    """Return the unknowns that minimise the weighted residuals, and the Jacobian of these residuals."""
    unknown = toolbox.ParameterDict()
    for name, start in zip(problem.start, x.tolist(), strict=True):
        unknown.add(toolbox.Parameter(name, start, 1 / RANGE, RANGE))
    limits = {"max_iters": 20, "eps": STEP, "xtol": 1e-3, "gtol": 1e-3}
    found, result = toolbox.optimize(unknown, problem.weighted_residuals, verbose=False, output=StringIO(), **limits)
    return found.as_vector(), result.jac


def _jackknife_covariance(residuals: Residuals, rows: Sequence[Array], jacobian: Array) -> Array:
    """Return the covariance of the fitted values by a jackknife over time windows [MacKinnonWhite1985]."""
    ends = np.cumsum([len(row) for row in rows])[:-1]
    parts: dict[tuple[int, int], tuple[Array, Array]] = {}
    for (_, piece, window), row, J in zip(residuals, rows, np.split(jacobian, ends), strict=True):
        H, g = parts.get((piece, window), (np.zeros((J.shape[1],) * 2), np.zeros(J.shape[1])))
        parts[piece, window] = H + J.T @ J, g + J.T @ row
    whole = jacobian.T @ jacobian
    moved = np.stack([np.linalg.pinv(whole - H) @ g for H, g in parts.values()])
    covariance: Array = moved.T @ moved * (len(moved) - 1) / len(moved)
    return covariance
