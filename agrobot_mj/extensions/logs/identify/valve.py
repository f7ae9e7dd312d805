"""Identification of the steering from a run: valve (dead band, gains, rate limit, time constant, delay) and backlash.

The steering model comes from the simulator: `hydraulics.valve_step` at 2 ms with the logged voltage, constant in each
tick. The cylinder is rigid, and there is play between the cylinder and the wheels. The simulated angle, averaged over a
tick as in the potentiometer, is compared with `steer_measured` in windows of 5 s. Each window has a separate offset,
which removes the effect of earlier motion. Least squares fits all parameters at once, with an initial delay from a
grid. The delay may be a fraction of a step.

A run only identifies excited parameters. The rate limit is None unless the valve reached this limit. The backlash is
None unless the run excites the play. Friction holds the wheels within the play. In a bend, above a fitted angle, the
tyres push the wheels towards straight ahead, against one side of the play. The delay includes the lag due to the
compliance of the oil (damping divided by stiffness of the cylinder, 8 ms). Windows at the steering stops are omitted.
Standard errors assume white residuals.
"""

from collections.abc import Sequence
from math import degrees, inf, sqrt
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pyarrow as pa
from scipy.optimize import OptimizeResult, least_squares

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.core.kernels import kernel
from agrobot_mj.core.signals import Array
from agrobot_mj.core.table_columns import FieldLogError, check_time, read_columns, source_name
from agrobot_mj.extensions.logs.identify.model import play
from agrobot_mj.machine.hydraulics import (
    LITRE_PER_MINUTE,
    Cylinder,
    Valve,
    ValveLaw,
    ValveMemory,
    valve_law,
    valve_step,
)

SHORTEST_TICK_S, LONGEST_TICK_S = 0.001, 0.5  # Minimum and maximum length of a tick [s]
UNEVEN = 0.5  # Maximum deviation of a time step from the median step, divided by the median step [-]
STEPS_PER_TICK = 25  # Number of model steps per tick: 2 ms steps in a 50 ms tick
WINDOW_S = 5.0  # Length of a window [s]: longer than delay and lag, shorter than slow unmodelled effects
LEAST_WINDOWS = 4  # Minimum number of windows for a fit
LEAST_MOTION_DEG = 0.5  # Minimum RMS motion of the steering within windows for a fit [deg]
NEAR_STOP_DEG = 1.0  # Distance from the steering stops below which a window is omitted [deg]
UNLIMITED_L_MIN = 1e4  # Pump flow that does not limit the steering rate [l/min]
SURE, PRECISE = 50.0, 0.1
"""Criteria for an identified rate limit or backlash [-]: minimum reduction of chi squared, and maximum standard error
divided by the fitted value."""
LEAST_EXPLAINED = 0.5
"""Minimum fraction of the angle variance that a valid fit explains [-]. Assumed value: typical runs give 0.99."""
COLUMNS = ("t", "valve_voltage", "steer_measured")  # Columns of the file `signals.parquet` that the fit uses
NAMES = (
    *("dead_band_v", "gain_left_l_min_v", "gain_right_l_min_v", "time_constant_s", "delay_s"),
    *("rate_limit_deg_s", "backlash_deg"),
)
"""Names of the reported parameters, in the order of the parameter vector."""
VALVE, RATE_LIMIT, BACKLASH, CENTRED = tuple(range(5)), 5, 6, 7
"""Indices in the parameter vector: valve parameters of every fit, and three optional parameters. `CENTRED` is the angle
above which the tyres press the linkage to one side of its play [deg]."""
LOW = np.array((0.0, 0.001, 0.001, 0.002, 0.0, 0.1, 0.0, 0.0))
HIGH = np.array((5.0, 50.0, 50.0, 2.0, 1.0, 500.0, 20.0, 90.0))
SCALE = np.array((0.1, 1.0, 1.0, 0.05, 0.05, 10.0, 0.5, 2.0))
"""Typical magnitudes of the parameters, used to scale the fit. Gains refer to the default cylinder."""
PLAYS_DEG, HOLDS_DEG = (0.2, 0.5, 1.0, 2.0, 4.0), (1.0, 2.0, 4.0, 8.0)
"""Candidate initial values of the backlash and of the angle `CENTRED` [deg]. The pair with the best fit is used."""


class Identified(NamedTuple):
    """Steering valve parameters and backlash identified from a run."""

    dead_band_v: float  # Half width of the dead band about neutral [V]
    gain_left_l_min_v: float  # Flow per volt outside the dead band, steering left [l/(min V)]
    gain_right_l_min_v: float  # Flow per volt outside the dead band, steering right [l/(min V)]
    rate_limit_deg_s: float | None
    """Maximum steering rate in both directions, limited by the pump flow [deg/s], or None if not reached in the run."""
    time_constant_s: float  # Time constant of the spool [s]
    delay_s: float  # Transport delay of the valve [s]
    backlash_deg: float | None  # Total play between cylinder and wheels [deg], or None if not identifiable
    errors: dict[str, float]  # Standard errors of the parameters by name, in the units of the parameters
    rate_reached_deg_s: float  # Maximum steering rate of the fitted model in the run [deg/s]
    residual_rms_deg: float  # RMS difference of measured and fitted angle, relative to the mean of each window [deg]
    explained: float  # Fraction of the variance of the measured angle within windows that the fit explains [-]


class Fitted(NamedTuple):
    """Result of one least-squares fit of the valve."""

    p: Array  # All parameters, shape (8,), with an infinite rate limit and zero backlash if these are not identified
    free: tuple[int, ...]  # Indices of the fitted parameters
    result: OptimizeResult  # Result of `scipy.optimize.least_squares`


class Data(NamedTuple):
    """Measurements used to fit the valve."""

    voltage: Array  # Valve voltage, constant in each tick, shape (n,) [V]
    measured: Array  # Measured steering angle, averaged over the preceding tick, shape (windows, ticks) [rad]
    kept: Array  # Mask of the windows that `measured` contains, shape (complete windows,)
    tick: float  # Length of a tick [s]
    displacement: float  # Oil volume of the cylinder divided by the steering angle [m3/rad]


def identify(signals: pa.Table | Path, cylinder: Cylinder | None = None, steer_limit_deg: float = 45.0) -> Identified:
    """Identify the valve from the signals of a run, given as a table or a Parquet file with the columns `COLUMNS`.

    `cylinder` (default: standard cylinder) converts steering rate to oil flow. Raises `ScenarioError` if the signals
    lack excitation.
    """
    data = _data(signals, cylinder or Cylinder(), steer_limit_deg)
    best = _fit(data, _start(data), VALVE)
    reached = _fastest(best.p, data)
    best = _better(data, best, (RATE_LIMIT,), [(max(0.95 * reached, LOW[RATE_LIMIT]),)])
    best = _with_play(data, best)
    explained = float(1.0 - 2 * best.result.cost / (_subtract_mean(data.measured) ** 2).sum())
    if not explained >= LEAST_EXPLAINED:
        share = f"{100 * explained:.0f} % of the motion, less than {100 * LEAST_EXPLAINED:.0f} %"
        raise ScenarioError(
            f"the valve is not identifiable, because the fit explains {share}; use voltage and angle from the same run"
        )
    values = {NAMES[k]: float(best.p[k]) if k in best.free else None for k in range(len(NAMES))}
    return Identified(
        **values,  # type: ignore[arg-type]  # parameters of every fit are never None
        errors={NAMES[k]: float(e) for k, e in zip(best.free, _errors(best, data), strict=True) if k < len(NAMES)},
        rate_reached_deg_s=_fastest(best.p, data),
        residual_rms_deg=degrees(sqrt(2 * best.result.cost / best.result.fun.size)),
        explained=explained,
    )


def _with_play(data: Data, fit: Fitted) -> Fitted:
    """Return a fit with backlash and the angle `CENTRED` if the run identifies them, otherwise `fit`."""
    held = _better(data, fit, (BACKLASH,), [(play,) for play in PLAYS_DEG])
    if held is not fit:
        return _better(data, held, (CENTRED,), [(hold,) for hold in HOLDS_DEG])
    return _better(data, fit, (BACKLASH, CENTRED), [(play, hold) for play in PLAYS_DEG for hold in HOLDS_DEG])


def _better(data: Data, fit: Fitted, extra: tuple[int, ...], starts: Sequence[tuple[float, ...]]) -> Fitted:
    """Return a fit that includes the parameters `extra`, started from the best of the initial values in `starts`.
    If the first parameter in `extra` is not identified, return `fit`."""

    def begun(start: tuple[float, ...]) -> Array:
        p = fit.p.copy()
        p[list(extra)] = start
        return p

    best = min(map(begun, starts), key=lambda p: float((_residuals(p, data) ** 2).sum()))
    wider = _fit(data, best, (*fit.free, *extra))
    gain = 2 * (fit.result.cost - wider.result.cost) / _variance(wider, data)
    seen = gain > SURE and _errors(wider, data)[len(fit.free)] < PRECISE * wider.p[extra[0]]
    return wider if seen else fit


def _data(signals: pa.Table | Path, cylinder: Cylinder, steer_limit_deg: float) -> Data:
    t, voltage, measured = read_columns(signals, COLUMNS).values()
    tick = _tick(source_name(signals), t)
    ticks = round(WINDOW_S / tick)
    windows = measured[: len(t) // ticks * ticks].reshape(-1, ticks)
    with np.errstate(invalid="ignore"):
        kept = np.abs(windows).max(axis=1, initial=0.0) < np.radians(steer_limit_deg - NEAR_STOP_DEG)
    if not np.isfinite(voltage).all():
        raise ScenarioError("the log has gaps in valve_voltage; use a run without gaps")
    if kept.sum() < LEAST_WINDOWS:
        needed = f"{LEAST_WINDOWS * WINDOW_S:g} s"
        raise ScenarioError(
            f"the log is too short: at least {needed} with the steering away from its stops are required"
        )
    moved = degrees(float(np.sqrt((_subtract_mean(windows[kept]) ** 2).mean())))
    if moved < LEAST_MOTION_DEG:
        raise ScenarioError(f"the steering hardly moves ({moved:.2g} deg rms in {WINDOW_S:g} s); use a run with turns")
    return Data(voltage, windows[kept], kept, tick, cylinder.displacement)


def _tick(name: str, t: Array) -> float:
    """Return the length of a tick [s]. Raises `FieldLogError` unless the times `t` (n,) [s] increase in even steps."""
    check_time(name, COLUMNS[0], t)
    where, steps = f"{name}: {COLUMNS[0]!r}", np.diff(t)
    usual = float(np.median(steps))
    if not SHORTEST_TICK_S <= usual <= LONGEST_TICK_S:
        wanted = f"{SHORTEST_TICK_S:g} to {LONGEST_TICK_S:g} s"
        raise FieldLogError(f"{where}: rows must be {wanted} apart, got {usual:g} s; check the unit")
    if (off := float(np.abs(steps - usual).max())) > UNEVEN * usual:
        gap = f"the interval is {usual:g} s, but one row is off by {off:.3g} s"
        raise FieldLogError(f"{where}: rows must be evenly spaced, but {gap}; fill the gaps")
    return usual


@kernel
def respond(law: ValveLaw, memory: ValveMemory, voltage: Array, dt: float, oil: Array) -> None:
    """Simulate the valve for the `voltage` (n,) of each tick [V]. Write oil volumes to `oil` (n * steps + 1,) [m3]."""
    oil[0], steps = 0.0, (oil.shape[0] - 1) // voltage.shape[0]
    for k in range(oil.shape[0] - 1):
        oil[k + 1] = oil[k] + valve_step(law, memory, voltage[k // steps]) * dt


def _angles(p: Array, data: Data) -> Array:
    """Return the simulated steering angle at every step [rad], without the delay, shape (n * steps + 1,)."""
    dt = data.tick / STEPS_PER_TICK
    flow = min(np.radians(p[RATE_LIMIT]) * data.displacement / LITRE_PER_MINUTE, UNLIMITED_L_MIN)
    valve = Valve(
        delay_s=0.0,
        dead_band_v=p[0],
        gain_left_l_min_v=p[1],
        gain_right_l_min_v=p[2],
        time_constant_s=p[3],
        pump_flow_l_min=flow,
    )
    oil = np.empty(len(data.voltage) * STEPS_PER_TICK + 1)
    respond(*valve_law(valve, dt), data.voltage, dt, oil)
    angle = oil / data.displacement
    if p[BACKLASH] > 0.0:
        play(angle.copy(), 0.5 * np.radians(p[BACKLASH]), np.radians(p[CENTRED]), angle)
    return angle


def _readings(p: Array, data: Data) -> Array:
    """Return the simulated potentiometer measurements by window [rad], with the shape of `data.measured`."""
    angle, dt = _angles(p, data), data.tick / STEPS_PER_TICK
    area = np.concatenate([[0.0], np.cumsum(0.5 * (angle[1:] + angle[:-1]) * dt)])
    ends = data.tick * np.arange(data.kept.size * data.measured.shape[1]) - p[4]
    times = dt * np.arange(len(area))
    mean = (np.interp(ends, times, area) - np.interp(ends - data.tick, times, area)) / data.tick
    windows: Array = mean.reshape(-1, data.measured.shape[1])[data.kept]
    return windows


def _subtract_mean(windows: Array) -> Array:
    centred: Array = windows - windows.mean(axis=1, keepdims=True)
    return centred


def _residuals(p: Array, data: Data) -> Array:
    return _subtract_mean(_readings(p, data) - data.measured).ravel()


def _start(data: Data) -> Array:
    """Return the initial parameters: best delay of a grid, equal gains on both sides, no rate limit, and no play."""
    measured, found = _subtract_mean(data.measured), []
    for delay in np.arange(0.0, 0.6, data.tick):
        model = _subtract_mean(_readings(np.array([0.3, 1.0, 1.0, 0.1, delay, inf, 0.0, 90.0]), data))
        gain = float((model * measured).sum() / max((model * model).sum(), 1e-12))
        found.append((float(((gain * model - measured) ** 2).sum()), gain, delay))
    _, gain, delay = min(found)
    return np.array([0.3, max(gain, 0.005), max(gain, 0.005), 0.1, delay, inf, 0.0, 90.0])


def _fit(data: Data, start: Array, free: tuple[int, ...]) -> Fitted:
    """Fit the parameters with the indices `free`, and keep the other parameters at their values in `start`."""
    chosen = list(free)

    def whole(p: Array) -> Array:
        full = start.copy()
        full[chosen] = p
        return full

    low, high = LOW[chosen], HIGH[chosen]
    inside, size = np.clip(start[chosen], low + 1e-6, high - 1e-6), SCALE[chosen] * _sizes(data, chosen)
    result = least_squares(lambda p: _residuals(whole(p), data), inside, bounds=(low, high), x_scale=size)
    return Fitted(whole(result.x), free, result)


def _sizes(data: Data, chosen: list[int]) -> Array:
    """Return scale factors of the parameters `chosen`. Gains scale with the displacement of the cylinder."""
    share = data.displacement / Cylinder().displacement
    return np.array([share if k in (1, 2) else 1.0 for k in chosen])


def _variance(fit: Fitted, data: Data) -> float:
    """Return the residual variance of the measurements [rad2]. The offset fitted to each window uses one degree of
    freedom."""
    return float(2 * fit.result.cost / (fit.result.fun.size - len(fit.free) - len(data.measured)))


def _errors(fit: Fitted, data: Data) -> Array:
    """Return the standard errors of the fitted parameters, which are very large for undetermined parameters."""
    information = fit.result.jac.T @ fit.result.jac / _variance(fit, data)
    errors: Array = np.sqrt(np.diag(np.linalg.inv(information + 1e-12 * np.eye(len(fit.free)))))
    return errors


def _fastest(p: Array, data: Data) -> float:
    return float(np.degrees(np.abs(np.diff(_angles(p, data))).max()) * STEPS_PER_TICK / data.tick)


def rate_of(flow_l_min: float, cylinder: Cylinder) -> float:
    """Return the steering rate [deg/s] for an oil flow `flow_l_min` [l/min] into the cylinder."""
    return degrees(flow_l_min * LITRE_PER_MINUTE / cylinder.displacement)
