"""Use of delayed fixes at their measurement time: dead reckoning extends the filter state at the newest fix.

Measurements newer than this state are queued. A fix corrects the core (the filter state) at the time of the fix, and
integration of the queued gyro and wheel measurements gives the current pose. Without latency the queue is empty. A fix
older than the core (after an increase of the latency) restores an earlier core from the history. A fix older than the
last fix is ignored. Without fixes the delay of the core remains constant.
"""

from math import cos, isfinite, isnan, nan, sin
from typing import NamedTuple

import numpy as np

from agrobot_mj.core.geometry import wrap
from agrobot_mj.core.held import Held
from agrobot_mj.core.kernels import copy_into, fetched, held, jit, stage
from agrobot_mj.core.levelling import SmoothedTilt
from agrobot_mj.core.signals import NO_FIX, Estimate, Fix, Matrix, Vector
from agrobot_mj.estimation.base import Health, Readings, largest_sigma
from agrobot_mj.estimation.equations import times
from agrobot_mj.estimation.full_core import Core, Inputs, side_of
from agrobot_mj.estimation.full_filter import FullFilter, step
from agrobot_mj.estimation.full_model import (
    B_G,
    B_S,
    MOUNT,
    OMEGA,
    PSI,
    FullLevels,
    K,
    N,
    S,
    SideLoad,
    V,
    X,
    Y,
    braking,
    course_slopes,
    sideslip,
    steady_gain,
    wheel_scale,
)
from agrobot_mj.estimation.lever_arm import offset

HISTORY_TICKS, BLOCK_TICKS = 110, 10
"""Minimum number of stored filter states, and number of states in a block; a tick copies only the last block. Assumed
value for a maximum receiver latency of 5 s, plus a margin."""


class Horizon(NamedTuple):
    """State of the filter at the newest fix, the measurements since then, and earlier states of the filter."""

    held: "Held[FullNumbers]"  # Numbers of the estimator, with the filter state `core` at the newest fix
    seen_t: float = -1.0  # Time of the newest fix [s]
    waiting: Matrix = np.zeros((0, 8))  # Measurements newer than `core`, oldest first: rows of `Inputs`, shape (n, 8)
    history: "tuple[tuple[tuple[Held[FullNumbers], float, Matrix], ...], ...]" = ((),)
    """Previous states in blocks, oldest first: state before a tick, time of its newest fix, and measurements used in
    the tick."""

    @property
    def core(self) -> Core:
        """Filter state at the time of the newest fix, as a named tuple."""
        return fetched(self.held).core

    def back(self, ticks: int) -> "Horizon":
        """Return the horizon at least `ticks` ticks earlier, with all later measurements in the queue again."""
        if ticks <= 0:
            return self
        before, seen_t, waiting, history = *self[:3], [tick for block in self.history for tick in block]
        while ticks > 0 and history:
            before, seen_t, used = history.pop()
            waiting, ticks = np.concatenate((used, waiting)), ticks - len(used)
        state = held(fetched(self.held)._replace(core=fetched(before).core))
        return Horizon(state, seen_t, waiting, (tuple(history),))

    def after(self, state: "Held[FullNumbers]", ticks: int) -> "Horizon":
        """Return the horizon with the new `state`, whose filter has used the first `ticks` rows of the queue."""
        seen_t, queue = _progress(state)
        *blocks, last = self.history[-1 - HISTORY_TICKS // BLOCK_TICKS :]
        if len(last) >= BLOCK_TICKS:
            blocks, last = [*blocks, last], ()
        last = (*last, (self.held, self.seen_t, queue[:ticks]))
        return Horizon(state, seen_t, queue[ticks:], (*blocks, last))

    def at(self, t: float, fix: Fix, dt: float) -> "tuple[Horizon, int, Fix]":
        """Return the horizon rewound for a fix received at `t` [s], the number of queued ticks up to the fix, and the
        fix.

        The fix is NaN if it is older than the last fix or the history.
        """
        late = max(0, round((t - fix.t) / dt)) if isfinite(fix.t) else 0
        past = sum(len(used) for block in self.history for _, _, used in block) if late else 0
        queued = len(self.waiting) + 1
        if late >= queued + past or t - late * dt < self.seen_t + 0.5 * dt:
            return self, 1, NO_FIX
        horizon = self.back(late + 1 - queued)
        return horizon, len(horizon.waiting) + 1 - late, fix


class Settings(NamedTuple):
    """Parameters of the estimator `ekf_full`, as numbers for compiled kernels."""

    filter: FullFilter  # Noise levels and limits of the filter
    cg: tuple[float, float, float]  # Position of the CG relative to the rear-axle point R: ahead, left and up [m]
    tilts: bool  # Whether measured roll and pitch are used (terrain compensation)
    body: bool  # Whether the gyro axis is fixed to the tractor


class Present(NamedTuple):
    """Estimated motion of the rear axle at the current time."""

    x: float  # East position of the rear-axle point R [m]
    y: float  # North position of the rear-axle point R [m]
    heading: float  # Heading of the tractor [rad], not wrapped
    sideslip: float  # Course of the rear-axle point R minus heading [rad]
    speed: float  # Speed of the rear-axle point R along its course [m/s]
    yaw_rate: float  # Estimated yaw rate [rad/s]
    covariance: Matrix  # Covariance of x, y and heading, shape (3, 3)


class Waiting(NamedTuple):
    """Measurements that the filter has not used before the current tick, and number of measurements to use in this
    tick."""

    rows: Matrix  # Measurements before this tick that the filter has not used, shape (n, 8), as in `Horizon.waiting`
    ticks: int  # Number of measurements, including the measurement of this tick, that the filter uses in this tick


class FullNumbers(NamedTuple):
    """State of the estimator `EkfFull` that changes in each tick, as numbers for compiled kernels."""

    core: Core  # Filter state
    queue: Matrix  # Waiting measurements of the last tick, followed by its own measurement, shape (n, 8)
    tilt: SmoothedTilt = SmoothedTilt(nan, nan)  # Smoothed roll and pitch, or NaN before the first tick
    health: Health = Health()  # Diagnostics that do not need the true state


@stage
def _progress(state: Held[FullNumbers]) -> tuple[float, Matrix]:
    now = fetched(state)
    return now.core.seen.t, now.queue


@stage
def estimate_tick(
    s: Held[Settings], w: Held[Waiting], state: Held[FullNumbers], m: Readings, fix: Fix, quality: int, dt: float
) -> tuple[Held[FullNumbers], Held[Estimate], Vector]:
    """Return the new state, the estimate, and the values of the columns of `EkfFull` at the end of a tick.

    The filter advances by the first `ticks` measurements of the queue; the fix corrects the last of these ticks.
    """
    s, (waiting, ticks), state = fetched(s), fetched(w), fetched(state)
    core, tilt, health = state.core, state.tilt, state.health
    roll, pitch = (m.roll, m.pitch) if s.tilts else (0.0, 0.0)
    first = isnan(tilt.roll)
    if not isfinite(roll + pitch):  # not measured: keep the last tilt
        roll, pitch = (0.0, 0.0) if first else (tilt.roll, tilt.pitch)
    tilt = SmoothedTilt(roll, pitch, 0.0, 0.0) if first else tilt.after(roll, pitch, dt)
    n, gyro = waiting.shape[0], tilt.heading_rate(m.gyro, s.body)
    queue = np.zeros((n + 1, 8))
    copy_into(queue[:n], waiting)
    for k, value in enumerate((m.t, gyro, m.wheel, m.steer, tilt.roll, tilt.pitch, roll, pitch)):
        queue[n, k] = value
    for k in range(ticks):
        core = step(s.filter, core, _inputs(queue, k), fix if k == ticks - 1 else NO_FIX, quality, dt)
    health = health.after(core.nis, core.rejections.accepted_t, dt)
    now, last = present(core, s.filter.levels, queue[ticks:], _inputs(queue, n), dt), _inputs(queue, n)
    east, north = offset(s.cg, roll, pitch, now.heading)
    estimate = Estimate(
        now.x + east,
        now.y + north,
        wrap(now.heading + now.sideslip),
        now.speed,
        now.yaw_rate,
        now.x,
        now.y,
        now.covariance,
        core.nis,
        core.mean[B_S],
        now.sideslip,
        not core.search.active,
        last.t - health.fix_t,
        largest_sigma(now.covariance),
        health.nis,
    )
    r, mount = core.rejections, core.mean[MOUNT] if core.mean.size > N else nan
    e, counts = estimate, (float(r.positions), float(r.velocities), float(r.restarts))
    own = (e.fix_age, e.position_sigma, e.nis_mean, 1.0 if e.aligned else 0.0, e.sideslip)
    logged = np.array((*own, core.mean[B_G], mount, core.mean[K], *counts))
    return held(FullNumbers(core, queue, tilt, health)), held(estimate), logged


@jit
def _inputs(queue: Matrix, k: int) -> Inputs:
    q = queue[k]
    return Inputs(q[0], q[1], q[2], q[3], q[4], q[5], (q[6], q[7]))


@jit
def present(core: Core, levels: FullLevels, waiting: Matrix, last: Inputs, dt: float) -> Present:
    """Return the current motion by dead reckoning with the queued measurements `waiting` (n, 8).

    The newest measurements `last` determine the side force.
    """
    mean, bend, ticks = core.mean, core.smooth.bend, waiting.shape[0]
    x, y, psi, v, omega = mean[X], mean[Y], mean[PSI], mean[V], mean[OMEGA]
    gain_v = steady_gain(levels.walks[3], levels.wheel_sigma, dt)
    gain_omega = steady_gain(levels.walks[4], levels.gyro_sigma, dt)
    for k in range(ticks):
        inputs = _inputs(waiting, k)
        side = SideLoad(side_of(inputs), bend)
        scale = wheel_scale(mean, inputs.pitch, braking(inputs.pitch, v, side, levels))
        v += gain_v * (inputs.wheel / scale - v) if isfinite(inputs.wheel) else 0.0
        omega += gain_omega * (inputs.gyro - mean[B_G] - omega) if isfinite(inputs.gyro) else 0.0
        chi = psi + sideslip(mean, v, side) + 0.5 * omega * dt
        if not core.search.active:
            x, y = x + v * dt * cos(chi), y + v * dt * sin(chi)
        psi += omega * dt
    P = _of_pose(core.covariance)
    if ticks:
        P = _pose_covariance(core, levels, (x - mean[X], y - mean[Y]), _inputs(waiting, ticks - 1), ticks * dt)
    return Present(x, y, psi, sideslip(mean, v, SideLoad(side_of(last), bend)), v, omega, P)


@jit
def _of_pose(covariance: Matrix) -> Matrix:
    P = np.zeros((3, 3))
    for i in range(3):
        for j in range(3):
            P[i, j] = covariance[i, j]
    return P


@jit
def _pose_covariance(core: Core, levels: FullLevels, moved: tuple[float, float], last: Inputs, time: float) -> Matrix:
    """Return the covariance of x, y and heading, shape (3, 3), after dead reckoning over `moved` [m] and `time` [s]."""
    east, north = moved
    side = SideLoad(side_of(last), core.smooth.bend)
    slopes, braked = course_slopes(core.mean, side), braking(last.pitch, core.mean[V], side, levels)
    G = np.zeros((3, slopes.size))
    for state in range(slopes.size):
        G[0, state], G[1, state] = -north * slopes[state], east * slopes[state]
    G[0, V] = G[1, V] = 0.0  # measured by the waiting wheel speeds
    G[0, X], G[1, Y], G[2, PSI] = 1.0, 1.0, 1.0
    by_scale = -1.0 / (wheel_scale(core.mean, last.pitch, braked) * cos(last.pitch))
    G[0, K], G[1, K] = by_scale * east, by_scale * north
    G[0, S], G[1, S] = -braked * G[0, K], -braked * G[1, K]
    G[0, B_G], G[1, B_G], G[2, B_G] = 0.5 * north * time, -0.5 * east * time, -time
    P = times(times(G, core.covariance), G.T)
    for state, walk in ((0, levels.walks[0]), (1, levels.walks[0]), (2, levels.walks[2])):
        P[state, state] += walk * walk * time
    return P
