"""Dead reckoning by wheels and gyro for the supervisor, starting at fixes of the last 30 s.

The path q of the rear axle R, a complex number, and its negative derivative h with respect to the tyre compliance C
follow from wheel speed w, yaw rate r and roll,

  dq = w exp(j (phi + beta)) dt,  dh = j f dq,    phi' = r,  beta = -C f,  f = w r + g sin(roll) + p sin(gamma)

in a frame at an unknown angle, with the integrated yaw rate phi, gravity g and the pull p of a working implement at the
angle gamma to the tractor. A reference is an extrapolation from an earlier fix, with seven states: position x, y of R,
angle theta of this frame, gyro bias b, wheel-scale error k, and corrections kappa of the sideslip and c of the
compliance. Between two fixes

  x + j y += exp(j (theta + kappa)) ((1 - k) dq - c dh),    theta -= b dt

All states have random walks; the random walks of k and kappa increase in turns and at large side forces f. Fixes and
two-antenna headings update reference 0. Every 5 s a copy of reference 0 starts a new reference, which receives no fix
for 30 s. A fix must be consistent with all references (integrity monitoring by extrapolation [Diesel1995]). This check
detects errors common to position and velocity, and jumps during gaps. Without a gyro, the antenna heading or the
steering angle gives the yaw rate. Without wheel speed or with spinning wheels, the fixes give the speed. SI units.
"""

from cmath import exp as turn
from cmath import phase
from math import isfinite, isnan, nan, radians, sqrt
from typing import NamedTuple

import numpy as np

from agrobot_mj.control.evidence import RTK_FIXED, Sensed
from agrobot_mj.control.sums import Sums, Vehicle, add_tick, heading_of
from agrobot_mj.core.geometry import wrap
from agrobot_mj.core.held import Held
from agrobot_mj.core.kernels import copy_into, fetched, held, jit, stage
from agrobot_mj.core.signals import Fix, Matrix, Quality, Vector
from agrobot_mj.machine.implements import TowedImplement
from agrobot_mj.machine.tractor import TractorParameters

EPOCH_S = 0.5  # Minimum time between two checked fixes [s]. Assumed value.
MEMORY_S, RENEWAL_S = 30.0, 5.0
"""Lifetime of a dead-reckoning reference, and interval between the starts of references [s]. Assumed values."""
HISTORY_TICKS = 101  # Number of ticks for which sums are stored: fixes arrive up to 5 s late
START_M = 1.5
"""Minimum distance between two fixes for the initial heading [m]. Assumed value for a heading error of 3 deg."""
POSITION_SIGMA, TILT_SIGMA, UNKNOWN_TILT_SIGMA = 0.03, 0.02, 0.06
"""Standard deviations [m] of a fix, and of the antenna position due to tilt with and without an inertial unit. Assumed
values: above the receiver noise of 2 cm; tilt errors of 0.6 and 2 deg at a height of 2 m."""
LOOSE_SIGMA, LOOSE_FIXES = 0.35, 40.0
"""Standard deviation of a fix that is not RTK-fixed [m], and number of consecutive fixes that share one error [-].
Assumed values for a float solution, whose error is correlated for 20 s."""
HEADING_SIGMA = radians(0.35)  # Standard deviation of a two-antenna heading [rad]. Assumed value.
START_SIGMAS = (0.04, 0.04, radians(3.0), radians(0.3), 0.05, radians(2.0), radians(0.25))
"""Initial standard deviations of the states, in the units of `References.means`. Assumed values for position and
heading from two fixes, a gyro before warm-up, and worn tyres on soil."""
POSITION_WALK, ANGLE_WALK, BIAS_WALK, COMPLIANCE_WALK = 0.005, radians(0.03), radians(0.003), radians(0.01)
"""Random walks of position [m/sqrt(s)], frame angle theta [rad/sqrt(s)], gyro bias [rad/s/sqrt(s)] and tyre compliance
[rad s2/m/sqrt(s)]. Assumed values for antenna oscillation, gyro noise, gyro warm-up and changes of the ground."""
HITCH_SIGMA = radians(2.0)
"""Standard deviation of the modelled hitch angle [rad]. Assumed value for sideslip of the tractor and implement."""
ROCKING_FACTOR = 2.0
"""Standard deviation of the antenna-position error due to tilt oscillation, divided by the mean distance of the antenna
from its mean position [-]. Assumed value, above 1 because the measured angles lag the oscillation."""
HEADING_GATE = 5.0  # Number of standard deviations above which a heading is rejected [-]. Assumed value.


Covariances = np.ndarray[tuple[int, int, int], np.dtype[np.float64]]


class References(NamedTuple):
    """States of all dead-reckoning references at the last checked fix. Fixes correct only the first reference."""

    means: Matrix
    """Means of x, y [m], theta [rad], gyro bias [rad/s], wheel-scale, sideslip and compliance errors, shape (n, 7)."""
    covariances: Covariances  # Covariances of the states in `means`, shape (n, 7, 7)
    begun: Vector  # Start time of each reference [s], shape (n,)

    @classmethod
    def first(cls, at: Sums, place: complex, theta: float) -> "References":
        """Return the first reference, which starts at a fix at `place` [m]. `theta` is the angle from the
        dead-reckoning frame to the map [rad]."""
        foot = place - turn(1j * theta) * (at.lever + at.behind)
        mean = np.array([[foot.real, foot.imag, theta, 0.0, 0.0, 0.0, 0.0]])
        return cls(mean, np.diag(np.square(START_SIGMAS))[None], np.array([at.t]))


@stage
def compare_with_fix(
    r: Held[References], last: Held[Sums], at: Held[Sums], fix: Fix, quality: int, m: Sensed, swing: float
) -> tuple[Held[References], float, float]:
    """Return the dead-reckoning references after a fix, and the distance of the fix from the least consistent reference
    [m].

    The last result is the standard deviation of this distance [m]. `last` and `at` are the dead-reckoning sums at the
    last checked fix and at this fix. `swing` is the position error of the antenna due to the hitch angle [m].
    """
    sums, before = fetched(at), fetched(last)
    tilt_error = (TILT_SIGMA if isfinite(m.roll + m.pitch) else UNKNOWN_TILT_SIGMA) + ROCKING_FACTOR * sums.rocking
    fixed = quality == RTK_FIXED
    error, sharing = (POSITION_SIGMA, 1.0) if fixed else (LOOSE_SIGMA, LOOSE_FIXES)
    variance, heading = error * error + tilt_error * tilt_error + swing * swing, heading_of(m, fix) - sums.phi
    after, distance, sigma = _advance_references(fetched(r), before, sums, fix, heading, variance, sharing)
    return held(after), distance, sigma


@jit
def _advance_references(
    r: References, last: Sums, at: Sums, fix: Fix, heading: float, variance: float, sharing: float
) -> tuple[References, float, float]:
    """Return the dead-reckoning references after a fix, and `distance` and `sigma` of `compare_with_fix` [m].

    `variance` [m2] is the variance of the fix position; `sharing` is the number of consecutive fixes with equal error.
    `heading` is the measured heading minus the integrated yaw rate [rad], or NaN if not measured.
    """
    means, P = r.means.copy(), r.covariances.copy()
    worst, distance, sigma = -1.0, 0.0, 0.0
    east, north = 0.0, 0.0
    for n in range(means.shape[0]):
        _predict(means[n], P[n], last, at)
        foot = complex(fix.x, fix.y) - turn(1j * means[n, 2]) * (at.lever + at.behind)
        x, y = foot.real - means[n, 0], foot.imag - means[n, 1]
        s_xx, s_xy, s_yy = P[n, 0, 0] + variance, P[n, 0, 1], P[n, 1, 1] + variance
        nis = (s_yy * x * x - 2.0 * s_xy * x * y + s_xx * y * y) / (s_xx * s_yy - s_xy * s_xy)
        if nis > worst:
            worst, distance = nis, sqrt(x * x + y * y)
            sigma = distance / sqrt(nis) if nis > 0.0 else sqrt(variance)
        if n == 0:
            east, north = x, y
    before = means[0, 1]
    _correct(means[0], P[0], 0, east, sharing * variance)
    _correct(means[0], P[0], 1, north - (means[0, 1] - before), sharing * variance)
    error, S = wrap(heading - means[0, 2]), P[0, 2, 2] + HEADING_SIGMA * HEADING_SIGMA
    if error * error <= HEADING_GATE * HEADING_GATE * S:  # false without a heading, or for an improbable one
        _correct(means[0], P[0], 2, error, HEADING_SIGMA * HEADING_SIGMA)
    return _drop_old_references(References(means, P, r.begun), at.t), distance, sigma


@jit
def _predict(mean: Vector, P: Matrix, last: Sums, at: Sums) -> None:
    """Predict the mean and covariance of one dead-reckoning reference in place, from the sums `last` to the sums
    `at`."""
    dt, dq, dh, turned_s = at.t - last.t, at.path - last.path, at.bent - last.bent, at.gyro_s - last.gyro_s
    theta, b, k, kappa, c = mean[2], mean[3], mean[4], mean[5], mean[6]
    ahead = turn(1j * (theta + kappa - 0.5 * b * turned_s))
    step = ahead * ((1.0 - k) * dq - c * dh)
    mean[0] += step.real
    mean[1] += step.imag
    mean[2] -= b * turned_s
    walks = (POSITION_WALK, POSITION_WALK, ANGLE_WALK, BIAS_WALK, 0.0, 0.0, COMPLIANCE_WALK)
    for state in range(7):
        P[state, state] += walks[state] * walks[state] * dt
    P[2, 2] += at.turning - last.turning
    P[4, 4] += at.slip - last.slip
    P[5, 5] += at.sideslip - last.sideslip
    slopes = (1j * step, -0.5j * turned_s * step, -ahead * dq, 1j * step, -ahead * dh)
    for transposed in (False, True):  # F P, then (F P) F'
        for j in range(7):
            A = P[:, j] if not transposed else P[j]
            x, y = A[0], A[1]
            for n in range(5):
                x += slopes[n].real * A[2 + n]
                y += slopes[n].imag * A[2 + n]
            A[0], A[1], A[2] = x, y, A[2] - turned_s * A[3]


@jit
def _correct(mean: Vector, P: Matrix, state: int, innovation: float, variance: float) -> None:
    row = P[state].copy()
    S = row[state] + variance
    for i in range(7):
        mean[i] += row[i] / S * innovation
        for j in range(7):
            P[i, j] -= row[i] / S * row[j]


@jit
def _drop_old_references(r: References, t: float) -> References:
    """Return the first dead-reckoning reference and all others younger than MEMORY_S [s]. If the newest reference is
    older than RENEWAL_S, a copy of the first reference is added."""
    n = r.begun.size
    means, P, begun, kept = np.zeros((n + 1, 7)), np.zeros((n + 1, 7, 7)), np.zeros(n + 1), 0
    for k in range(n):
        if k == 0 or t - r.begun[k] < MEMORY_S:
            copy_into(means[kept], r.means[k])
            copy_into(P[kept], r.covariances[k])
            begun[kept] = r.begun[k]
            kept += 1
    if t - begun[kept - 1] > RENEWAL_S:
        copy_into(means[kept], r.means[0])
        copy_into(P[kept], r.covariances[0])
        begun[kept] = t
        kept += 1
    return References(means[:kept], P[:kept], begun[:kept])


class Reckoning(NamedTuple):
    """State of the supervisor's dead reckoning between two ticks."""

    sums: tuple[Held[Sums], ...] = ()  # Dead-reckoning sums after each of the last ticks, oldest first
    checked: Held[Sums] | None = None  # Dead-reckoning sums at the last checked fix, or None before the first fix
    begun_at: complex = 0j  # Position of the first fix [m], east + j north
    references: Held[References] | None = None
    """Dead-reckoning references for checking fixes, or None until the frame angle theta is known."""
    distance: float = nan
    """Distance of the last checked fix from the least consistent dead-reckoning reference [m], or NaN before the first
    checked fix."""
    sigma: float = nan  # Standard deviation of `distance` [m], or NaN before the first checked fix
    checked_t: float = nan  # Time of `checked` [s], or NaN before the heading is known

    def after(
        self,
        m: Sensed,
        fix: Fix,
        quality: int,
        machine: TractorParameters,
        body: bool,
        dt: float,
        towed: TowedImplement,
    ) -> "Reckoning":
        """Return the state after a tick of `dt` [s]. Dead reckoning starts with the first gyro measurement.

        A missing fix is NaN. The axis of the gyro is fixed to the tractor if `body`, otherwise vertical.
        """
        if self.checked is None and not isfinite(m.gyro):
            return self
        vehicle = Vehicle(machine.wheelbase_m, machine.antenna_height_m, body)
        before = self.sums or (held(Sums()),)
        sums = (*before[1 - HISTORY_TICKS :], add_tick(before[-1], m, fix, vehicle, towed, dt))
        late = round((m.t - fix.t) / dt) if isfinite(fix.t) else 0
        first = self.references is None and quality != Quality.FIX
        state = Reckoning(sums, *self[1:])
        if isnan(fix.x) or first or not 0 <= late < len(sums):
            return state
        if state.references and m.t - late * dt - state.checked_t < EPOCH_S - 0.5 * dt:
            return state
        return state._with_fix(sums[-1 - late], fix, quality, m, HITCH_SIGMA * towed.antenna)

    def _with_fix(self, at: Held[Sums], fix: Fix, quality: int, m: Sensed, swing: float) -> "Reckoning":
        """Return the state after checking a fix; `swing` is the antenna's position error due to the hitch angle [m]."""
        place = complex(fix.x, fix.y)
        if self.checked is None:
            return self._replace(checked=at, begun_at=place)
        if self.references is None:
            sums = fetched(at)
            moved = sums.path - fetched(self.checked).path
            if abs(moved) < START_M:
                return self
            theta = phase((place - self.begun_at) / moved)
            return self._replace(checked=at, references=held(References.first(sums, place, theta)), checked_t=sums.t)
        found, distance, sigma = compare_with_fix(self.references, self.checked, at, fix, quality, m, swing)
        return self._replace(checked=at, references=found, distance=distance, sigma=sigma, checked_t=fetched(at).t)
