"""Use of delayed fixes at their own time: filter state at the newest fix, extended by dead reckoning.

Newer measurements wait in a queue. A fix corrects the core (the filter state) at the time of the fix, and integrating
the queued gyro and wheel measurements gives the current pose. Without latency the queue is empty. A fix older than the
core (increased latency) restores an earlier core from the history; a fix older than the last fix is ignored. Without
fixes the delay of the core remains constant.
"""

from math import cos, isfinite, sin
from typing import NamedTuple

import numpy as np

from agrobot_mj.core.signals import Array, Fix
from agrobot_mj.estimation.full_core import Core, Inputs
from agrobot_mj.estimation.full_filter import FullFilter
from agrobot_mj.estimation.full_model import (
    B_G,
    PSI,
    FullLevels,
    K,
    S,
    V,
    X,
    Y,
    course_slopes,
    sideslip,
    steady_gain,
    wheel_scale,
)
from agrobot_mj.machine.tractor import GRAVITY

HISTORY_TICKS = 110
"""Number of stored cores. Assumed value for the maximum latency of a receiver, 5 s, plus a margin."""


class Horizon(NamedTuple):
    """Filter state at the newest fix, measurements since then, and previous states."""

    core: Core
    """Filter state at the time of the newest fix."""
    waiting: tuple[Inputs, ...] = ()
    """Measurements after the time of the core, oldest first."""
    history: tuple[tuple[Core, Inputs], ...] = ()
    """Core before each tick and inputs of the tick, oldest first."""

    def after(self, filter_: FullFilter, inputs: Inputs, fix: Fix | None, quality: int, dt: float) -> "Horizon":
        """Return the filter state and its queue after a tick of `dt` [s]."""
        horizon = self._replace(waiting=(*self.waiting, inputs))
        late = 0 if fix is None or not isfinite(fix.t) else max(0, round((inputs.t - fix.t) / dt))
        stale = late >= len(horizon.waiting) + len(self.history) or inputs.t - late * dt < self.core.seen_t + 0.5 * dt
        if fix is None or stale:
            return horizon._advanced(filter_, len(horizon.waiting) - len(self.waiting), dt)
        horizon = horizon._back(late + 1 - len(horizon.waiting))
        horizon = horizon._advanced(filter_, len(horizon.waiting) - late - 1, dt)
        return horizon._stepped(filter_, fix, quality, dt)

    def _back(self, ticks: int) -> "Horizon":
        """Return the filter state before the last `ticks`, with all later measurements queued again."""
        if ticks <= 0:
            return self
        undone = self.history[-ticks:]
        waiting = (*(inputs for _, inputs in undone), *self.waiting)
        return Horizon(undone[0][0], waiting, self.history[:-ticks])

    def _advanced(self, filter_: FullFilter, ticks: int, dt: float) -> "Horizon":
        """Return the filter state after `ticks` of the queued measurements, without a fix."""
        horizon = self
        for _ in range(ticks):
            horizon = horizon._stepped(filter_, None, self.core.quality, dt)
        return horizon

    def _stepped(self, filter_: FullFilter, fix: Fix | None, quality: int, dt: float) -> "Horizon":
        """Return the filter state after the oldest queued measurement, corrected by its fix."""
        first, *rest = self.waiting
        core = filter_.step(self.core, first, fix, quality, dt)
        return Horizon(core, tuple(rest), (*self.history[-HISTORY_TICKS:], (self.core, first)))


class Present(NamedTuple):
    """Estimate at the current time."""

    x: float
    """East position of the rear-axle point R [m]."""
    y: float
    """North position of the rear-axle point R [m]."""
    heading: float
    """Heading of the tractor, not wrapped [rad]."""
    sideslip: float
    """Course of the rear-axle point R minus heading [rad]."""
    speed: float
    """Speed of the rear-axle point R along its course [m/s]."""
    yaw_rate: float
    """Yaw rate [rad/s]."""
    covariance: Array
    """Covariance of x, y and heading, shape (3, 3)."""


def present(horizon: Horizon, levels: FullLevels, side: float, dt: float) -> Present:
    """Return the estimate by dead reckoning with the queued measurements; `side` is the lateral gravity [m/s2]."""
    core = horizon.core
    x, y, psi, v, omega = core.mean[:5].tolist()
    x_0, y_0, bias = x, y, float(core.mean[B_G])
    gain_v, gain_omega = _gains(levels, dt)
    for inputs in horizon.waiting:
        v += gain_v * (inputs.wheel / wheel_scale(core.mean, inputs.pitch) - v) if isfinite(inputs.wheel) else 0.0
        omega += gain_omega * (inputs.gyro - bias - omega) if isfinite(inputs.gyro) else 0.0
        chi = psi + sideslip(core.mean, v, core.side_load(inputs.side)) + 0.5 * omega * dt
        if core.search is None:
            x, y = x + v * dt * cos(chi), y + v * dt * sin(chi)
        psi += omega * dt
    P = core.covariance[:3, :3]
    if horizon.waiting:
        P = _extrapolated(core, levels, (x - x_0, y - y_0), horizon.waiting[-1], len(horizon.waiting) * dt)
    return Present(x, y, psi, sideslip(core.mean, v, core.side_load(side)), v, omega, P)


def _gains(levels: FullLevels, dt: float) -> tuple[float, float]:
    """Return the steady-state gains of wheel and gyro measurements for speed and yaw rate [-]."""
    return (
        steady_gain(levels.walks[3], levels.wheel_sigma, dt),
        steady_gain(levels.walks[4], levels.gyro_sigma, dt),
    )


def _extrapolated(core: Core, levels: FullLevels, moved: tuple[float, float], last: Inputs, time: float) -> Array:
    """Return the covariance of x, y and heading after dead reckoning over `moved` [m] in `time` [s], shape (3, 3)."""
    east, north = moved
    slopes = course_slopes(core.mean, core.side_load(last.side))
    G = np.array([-north * slopes, east * slopes, np.zeros(len(slopes))])
    G[:2, V] = 0.0  # measured by the waiting wheel speeds
    G[0, X], G[1, Y], G[2, PSI] = 1.0, 1.0, 1.0
    by_scale = -1.0 / (wheel_scale(core.mean, last.pitch) * cos(last.pitch))
    G[0, K], G[1, K] = by_scale * east, by_scale * north
    G[:2, S] = -GRAVITY * sin(last.pitch) * G[:2, K]
    G[0, B_G], G[1, B_G], G[2, B_G] = 0.5 * north * time, -0.5 * east * time, -time
    walk, yaw_walk = levels.walks[0], levels.walks[2]
    own = np.diag([walk * walk * time, walk * walk * time, yaw_walk * yaw_walk * time])
    return np.asarray(G @ core.covariance @ G.T + own, dtype=np.float64)
