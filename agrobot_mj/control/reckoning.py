"""Dead reckoning by wheels and gyro for the supervisor, starting at fixes of the last 30 s.

The path of the rear axle R and its derivative with respect to the tyre compliance C are sums over wheel speed w, yaw
rate r and roll,

  dq = w exp(j (phi + beta)) dt,  dh = j f dq,    phi' = r,  beta = -C f,  f = w r + g sin(roll) + p sin(gamma)

in a frame at an unknown angle, with the pull p of a working implement at the angle gamma to the tractor. A reference
has seven states: position x, y of R, angle theta of this frame, gyro bias b, wheel scale k, sideslip kappa and
compliance c in addition to the model. Between two fixes

  x + j y += exp(j (theta + kappa)) ((1 - k) dq - c dh),    theta -= b dt

All states except x, y are random walks, faster in turns with a large side force f. Fixes and two-antenna headings
update reference 0. Every 5 s a copy of it starts a new reference, which receives no fix for 30 s. A fix must be
consistent with all references (integrity monitoring by extrapolation [Diesel1995]), which expose errors common to
position and velocity, and jumps during a gap. Without a gyro, the antenna heading or the steering angle gives the yaw
rate. Without wheel speed or with spinning wheels, the fixes give the speed. SI units.
"""

from cmath import exp as turn
from cmath import phase
from math import atan, copysign, cos, hypot, isfinite, nan, radians, remainder, sin, sqrt, tan, tau
from typing import NamedTuple

import numpy as np

from agrobot_mj.core.levelling import SmoothedTilt
from agrobot_mj.core.signals import Array, Fix, Measurement, Quality
from agrobot_mj.machine.implements import TowedImplement
from agrobot_mj.machine.tractor import GRAVITY, TractorParameters

EPOCH_S = 0.5
"""Minimum time between two checked fixes [s]. Assumed value."""
MEMORY_S, RENEWAL_S = 30.0, 5.0
"""Lifetime of a reference and interval between the starts of references [s]. Assumed values."""
HISTORY_TICKS = 101
"""Number of ticks for which sums are stored: fixes arrive up to 5 s late."""
START_M = 1.5
"""Minimum distance between the two fixes that give the initial theta [m]. Assumed value for an accuracy of 3 deg."""
COMPLIANCE = radians(0.8)
"""Modelled compliance C of the tyres [rad s2/m]. Assumed value: 0.5 on soil, 0.8-1 on firm ground [deg s2/m]."""
CLIMB_SLIP = 0.01
"""Modelled wheel slip per longitudinal gravity [s2/m]. Assumed value for firm ground; higher on soil."""
POSITION_SIGMA, TILT_SIGMA, UNKNOWN_TILT_SIGMA = 0.03, 0.02, 0.06
"""Standard deviations of a fix, and of the antenna position due to tilt with and without an inertial unit [m]. Assumed
values: 2 cm for the fix; 0.6 and 2 deg at a height of 2 m."""
LOOSE_SIGMA, LOOSE_FIXES = 0.35, 40.0
"""Standard deviation of a fix below FIX quality [m], and number of consecutive fixes with equal error [-]. Assumed
values: a float solution, correlated for 20 s."""
HEADING_SIGMA = radians(0.35)
"""Standard deviation of a two-antenna heading [rad]. Assumed value."""
COMPASS_S = 5.0
"""Time constant for comparing the antenna heading with the gyro [s]. Assumed value, fast compared with gyro drift."""
BRIDGED_SIGMA = radians(0.15)
"""Standard deviation added to theta at the loss of the gyro [rad]. Assumed value, the smoothed `HEADING_SIGMA`."""
START_SIGMAS = (0.04, 0.04, radians(3.0), radians(0.3), 0.05, radians(2.0), radians(0.25))
"""Initial standard deviations of the states. Assumed values for two fixes, a cold gyro, worn tyres and soil."""
POSITION_WALK, ANGLE_WALK, BIAS_WALK, COMPLIANCE_WALK = 0.005, radians(0.03), radians(0.003), radians(0.01)
"""Random walks of position [m/sqrt(s)], theta [rad/sqrt(s)], b [rad/s/sqrt(s)] and c [rad s2/m/sqrt(s)]. Assumed
values: antenna oscillation, gyro noise, warm-up, changes of the ground."""
SIDESLIP_WALK, SLIP_WALK = (radians(0.04), radians(0.12)), (0.002, 0.003)
"""Random walks of kappa and k: per time [rad/sqrt(s), 1/sqrt(s)] and per rotation [rad/sqrt(rad), 1/sqrt(rad)]. Assumed
values for six machines on level, rough, sloping and soft ground."""
SLIDING, UNKNOWN_FORCE = 2.4, 3.5
"""Specific force that doubles the random walks of kappa and k (fourth-power law), and specific force assumed without an
inertial unit [m/s2]. Assumed values: tyres begin to slide on slopes of 15 deg; unmeasured slopes of up to 15 deg."""
DRAUGHT = 3.0
"""Specific pull of a working implement at the rear axle [m/s2]. Assumed value: draught of one sixth of the tractor's
weight (0.1-0.3), divided by the mass on the rear axle."""
HITCH_SIGMA = radians(2.0)
"""Standard deviation of the modelled hitch angle [rad]. Assumed value for the sideslip of implement and tractor."""
HOPPING = 0.3
"""Variation of the vertical specific force, divided by g, that doubles the random walks of kappa and k [-]. Assumed
value: 3 cm ridges cause 0.3 at 1.8 m/s and 1 at 3 m/s (sideslip of 7 deg), other ground at most 0.15."""
ROCKING_S = 2.0
"""Time constant for averaging the antenna oscillation and the vertical force [s]. Assumed value."""
ROCKING_FACTOR = 2.0
"""Standard deviation of the antenna position, divided by its oscillation [-]. Assumed value; angles lag half a
period."""
SPEEDS_S = 1.0
"""Time constant for smoothing wheel and fix speeds before comparison [s]. Assumed value."""
SLIPPING = 0.97
"""Ratio of fix speed to wheel speed below which the wheels spin [-]. Assumed value."""
SPINNING = 0.9
"""Ratio of fix to wheel speed below which the random walk of k increases [-]. Assumed value; smoothed speeds lag."""
STANDING_M_S = 0.05
"""Wheel speed below which the tractor is at rest and its yaw rate is zero [m/s]. Assumed value."""
STEERED_WALK = radians(1.5)
"""Random walk of theta if the steering angle gives the yaw rate [rad/sqrt(s)]. Assumed value for a bias of 2 deg."""
HEADING_GATE = 5.0
"""Normalised error above which a heading is rejected [-]. Assumed value."""


class Compass(NamedTuple):
    """Two-antenna heading minus phi, smoothed while a gyro is available."""

    angle: float = nan
    """Smoothed difference between heading and phi; NaN before the first heading [rad]."""
    rate: float = 0.0
    """Rate of the difference, the negative gyro error [rad/s]."""

    def after(self, shown: float, dt: float) -> "Compass":
        """Return the state after `dt` [s] for the measured difference `shown` [rad]; NaN without a heading."""
        if not isfinite(self.angle):
            return Compass(shown)
        angle = self.angle + self.rate * dt
        if not isfinite(shown):
            return self._replace(angle=angle)
        error, weight = remainder(shown - angle, tau), dt / COMPASS_S
        return Compass(angle + 2.0 * weight * error, self.rate + weight * weight / dt * error)


class Sums(NamedTuple):
    """Sums over all ticks up to time `t`."""

    t: float = 0.0
    """Time of the last tick [s]."""
    phi: float = 0.0
    """Integral phi of the yaw rate [rad]."""
    path: complex = 0j
    """Path q of the rear axle in the frame of the sums [m]."""
    bent: complex = 0j
    """Derivative h of the path with respect to the tyre compliance [m2/s2]."""
    sideslip: float = 0.0
    """Accumulated variance of the random walk of the sideslip kappa [rad2]."""
    slip: float = 0.0
    """Accumulated variance of the random walk of the wheel scale k [-]."""
    lever: complex = 0j
    """Antenna position relative to the rear axle in the frame of the path [m]."""
    behind: complex = 0j
    """Position of the implement's antenna relative to the rear axle in the path frame; 0 for one on the tractor [m]."""
    rest: complex = 0j
    """Mean of `lever` over `ROCKING_S` [m]."""
    rocking: float = 0.0
    """Mean distance of `lever` from its mean [m]."""
    swing: float = 0.0
    """Angle gamma between towed implement and tractor, from the path of the rear axle; 0 in steady reverse [rad]."""
    hopping: float = 0.0
    """Mean variation of the vertical specific force, divided by g; 0 if the force is not measured [-]."""
    wheels: float = 0.0
    """Smoothed wheel speed at the times of the fixes [m/s]."""
    fixes: float = 0.0
    """Smoothed speed of the fixes [m/s]."""
    fix_t: float = 0.0
    """Time of the last fix [s]."""
    tilt: SmoothedTilt = SmoothedTilt(0.0, 0.0)
    """Smoothed roll and pitch."""
    compass: Compass = Compass()
    """Antenna heading relative to phi, which replaces the gyro after a failure."""
    gyro_s: float = 0.0
    """Accumulated time with gyro measurements, during which the gyro bias rotates theta [s]."""
    turning: float = 0.0
    """Variance of theta accumulated without a gyro [rad2]."""
    blind: bool = False
    """Whether the gyro measurement was missing in the last tick."""

    def after(self, m: Measurement, machine: TractorParameters, body: bool, dt: float, towed: TowedImplement) -> "Sums":
        """Return the sums after a tick of `dt` [s]; the gyro axis is vertical, or fixed to the tractor with `body`."""
        wheels, fixes, fix_t = self._speeds(m)
        has_tilt = isfinite(m.roll + m.pitch)
        tilt = self.tilt.after(m.roll, m.pitch, dt) if has_tilt else self.tilt
        side, climb = (GRAVITY * sin(m.roll), GRAVITY * sin(m.pitch)) if has_tilt else (0.0, 0.0)
        w = self._speed(m) * (cos(m.pitch) * (1.0 + CLIMB_SLIP * climb) if has_tilt else 1.0)
        heading, seen = _heading(m), isfinite(m.gyro)
        rate, turning = self._turn(m, heading, tilt.heading_rate(m.gyro, body) if has_tilt else m.gyro, w, machine, dt)
        phi = self.phi + rate * dt
        swing = self.swing - (rate + abs(w) * sin(self.swing) / towed.length) * dt if towed.length else 0.0
        force = w * rate + side + DRAUGHT * sin(swing) * towed.working
        step = w * dt * turn(1j * (self.phi + 0.5 * rate * dt - COMPLIANCE * force))
        lever = (
            machine.antenna_height_m * complex(sin(m.pitch), -sin(m.roll)) * turn(1j * phi) if has_tilt else self.lever
        )
        rest = self.rest + (lever - self.rest) * dt / ROCKING_S
        pull = hypot(force, climb) if has_tilt else UNKNOWN_FORCE
        growth = (1.0 + (pull / SLIDING) ** 4 + (self.hopping / HOPPING) ** 4) ** 2
        weight = getattr(m.readings.get("imu"), "force_z", nan) / GRAVITY
        varied = abs(weight - 1.0) if isfinite(weight) else 0.0
        return Sums(
            t=m.t,
            phi=phi,
            path=self.path + step,
            bent=self.bent + 1j * force * step,
            sideslip=self.sideslip + growth * _walk_variance(SIDESLIP_WALK, rate, dt),
            slip=self.slip + growth * _walk_variance(SLIP_WALK, rate, dt) + self._spinning() ** 2 * dt,
            lever=lever,
            behind=-towed.antenna * turn(1j * (phi + swing)),
            rest=rest,
            rocking=self.rocking + (abs(lever - rest) - self.rocking) * dt / ROCKING_S,
            swing=swing,
            hopping=self.hopping + (varied - self.hopping) * dt / ROCKING_S,
            wheels=wheels,
            fixes=fixes,
            fix_t=fix_t,
            tilt=tilt,
            compass=self.compass.after(heading - phi, dt) if seen else self.compass,
            gyro_s=self.gyro_s + dt * seen,
            turning=self.turning + turning,
            blind=not seen,
        )

    def _turn(
        self, m: Measurement, heading: float, gyro: float, w: float, machine: TractorParameters, dt: float
    ) -> tuple[float, float]:
        """Return the yaw rate at speed `w` [m/s] and the added variance of theta: gyro, antennas or steering angle."""
        standing = abs(w) < STANDING_M_S
        if isfinite(m.gyro):
            return (0.0 if standing else gyro), 0.0
        lost = 0.0 if self.blind else BRIDGED_SIGMA**2
        if isfinite(heading + self.compass.angle):
            return remainder(heading - self.compass.angle - self.phi, tau) / dt, lost
        rate = 0.0 if standing else w * tan(m.steer) / machine.wheelbase_m
        return rate, STEERED_WALK**2 * dt + lost

    def _speed(self, m: Measurement) -> float:
        """Return the speed of R: that of the wheels, reduced while they spin, or else that of the last fixes [m/s]."""
        if not isfinite(m.wheel_speed):
            return copysign(self.fixes, m.pedal)
        spinning = self.fixes < SLIPPING * self.wheels
        return m.wheel_speed * self.fixes / (SLIPPING * self.wheels) if spinning else m.wheel_speed

    def _spinning(self) -> float:
        """Return the wheel slip above the tolerance `SPINNING` [-]."""
        return max(1.0 - self.fixes / (SPINNING * self.wheels), 0.0) if self.wheels > STANDING_M_S else 0.0

    def _speeds(self, m: Measurement) -> tuple[float, float, float]:
        if m.fix is None:
            return self.wheels, self.fixes, self.fix_t
        weight = min((m.t - self.fix_t) / SPEEDS_S, 1.0)
        fixes = self.fixes + weight * (hypot(m.fix.vx, m.fix.vy) - self.fixes)
        wheels = self.wheels + weight * (abs(m.wheel_speed) - self.wheels) if isfinite(m.wheel_speed) else fixes
        return wheels, fixes, m.t


def _heading(m: Measurement) -> float:
    """Return the two-antenna heading, corrected for the tilt of the tractor; NaN without such a heading [rad]."""
    if m.fix is None:
        return nan
    return m.fix.heading + (atan(sin(m.pitch) * tan(m.roll)) if isfinite(m.roll + m.pitch) else 0.0)


def _walk_variance(walk: tuple[float, float], rate: float, dt: float) -> float:
    return (walk[0] ** 2 + walk[1] ** 2 * abs(rate)) * dt


class References(NamedTuple):
    """All references at the time of the last checked fix; fixes update only the first reference."""

    means: Array
    """Means of position x, y, angle theta, gyro bias b, wheel scale k, sideslip kappa, compliance c, shape (n, 7)."""
    covariances: Array
    """Covariances of the states, shape (n, 7, 7)."""
    begun: tuple[float, ...]
    """Time since which each reference has received no fix [s]."""

    @classmethod
    def first(cls, at: Sums, place: complex, theta: float) -> "References":
        """Return the first reference, from a fix at `place` [m] and the frame angle theta [rad]."""
        foot = place - turn(1j * theta) * (at.lever + at.behind)
        mean = np.array([[foot.real, foot.imag, theta, 0.0, 0.0, 0.0, 0.0]])
        return cls(mean, np.diag(np.square(START_SIGMAS))[None], (at.t,))

    def predicted(self, last: Sums, at: Sums) -> "References":
        """Return the references with means and covariances propagated from `last` to `at`."""
        dt, dq, dh, turned_s = at.t - last.t, at.path - last.path, at.bent - last.bent, at.gyro_s - last.gyro_s
        theta, b, k, kappa, c = self.means[:, 2:].T
        ahead = np.exp(1j * (theta + kappa - 0.5 * b * turned_s))
        step = ahead * ((1.0 - k) * dq - c * dh)
        means = self.means.copy()
        means[:, 0] += step.real
        means[:, 1] += step.imag
        means[:, 2] -= b * turned_s
        slopes = np.stack((1j * step, -0.5j * turned_s * step, -ahead * dq, 1j * step, -ahead * dh), axis=1)
        F = np.tile(np.eye(7), (len(means), 1, 1))
        F[:, 0, 2:] = slopes.real
        F[:, 1, 2:] = slopes.imag
        F[:, 2, 3] = -turned_s
        walks = np.array((POSITION_WALK, POSITION_WALK, ANGLE_WALK, BIAS_WALK, 0.0, 0.0, COMPLIANCE_WALK)) ** 2 * dt
        walks[2] += at.turning - last.turning
        walks[4:6] = at.slip - last.slip, at.sideslip - last.sideslip
        P = F @ (self.covariances + np.diag(walks)) @ F.transpose(0, 2, 1)
        return self._replace(means=means, covariances=P)

    def checked(self, at: Sums, fix: Fix, variance: float, sharing: float = 1.0) -> "tuple[References, float, float]":
        """Return the references after a fix, and the maximum contradiction: distance of the fix and its sigma [m].

        `variance` [m2] is that of the fix position; `sharing` is the number of consecutive fixes with equal error.
        """
        foot = complex(fix.x, fix.y) - np.exp(1j * self.means[:, 2]) * (at.lever + at.behind)
        off = np.stack((foot.real, foot.imag), axis=1) - self.means[:, :2]
        S = self.covariances[:, :2, :2] + variance * np.eye(2)
        nis = np.einsum("ni,nij,nj->n", off, np.linalg.inv(S), off)
        worst = int(np.argmax(nis))
        distance = hypot(*off[worst].tolist())
        followed = self._corrected(np.eye(2, 7), off[0], S[0] + (sharing - 1.0) * variance * np.eye(2))
        return followed, distance, distance / sqrt(nis[worst]) if nis[worst] > 0.0 else sqrt(variance)

    def turned(self, heading: float) -> "References":
        """Return the references after a measured difference between heading and phi [rad], rejected if improbable."""
        error = remainder(heading - float(self.means[0, 2]), tau)
        S = float(self.covariances[0, 2, 2]) + HEADING_SIGMA**2
        if error * error > HEADING_GATE**2 * S:
            return self
        return self._corrected(np.eye(1, 7, 2), np.array([error]), np.array([[S]]))

    def _corrected(self, H: Array, innovation: Array, S: Array) -> "References":
        means, P = self.means.copy(), self.covariances.copy()
        gain = P[0] @ H.T @ np.linalg.inv(S)
        means[0] += gain @ innovation
        P[0] -= gain @ H @ P[0]
        return self._replace(means=means, covariances=P)

    def renewed(self, t: float) -> "References":
        """Return the references without those that are too old at `t` [s], and with a new one if it is due."""
        keep = [0, *(n for n, begun in enumerate(self.begun) if n and t - begun < MEMORY_S)]
        begun = tuple(self.begun[n] for n in keep)
        if t - begun[-1] > RENEWAL_S:
            keep, begun = [*keep, 0], (*begun, t)
        return References(self.means[keep], self.covariances[keep], begun)


class Reckoning(NamedTuple):
    """State of the dead reckoning."""

    sums: tuple[Sums, ...] = (Sums(),)
    """Accumulated sums of the last ticks, oldest first."""
    checked: Sums | None = None
    """Accumulated sums at the last checked fix; None before the first fix."""
    begun_at: complex = 0j
    """Position of the first fix [m]."""
    references: References | None = None
    """References for checking fixes; None until the frame angle theta is known."""
    distance: float = nan
    """Distance of the last checked fix from the most contradicting reference; NaN before the first checked fix [m]."""
    sigma: float = nan
    """Standard deviation of `distance`; NaN before the first checked fix [m]."""

    def after(
        self, m: Measurement, machine: TractorParameters, body: bool, dt: float, towed: TowedImplement
    ) -> "Reckoning":
        """Return the state after a tick of `dt` [s], starting at the first gyro measurement; see `Sums.after`."""
        if self.checked is None and not isfinite(m.gyro):
            return self
        state = self._replace(sums=(*self.sums[1 - HISTORY_TICKS :], self.sums[-1].after(m, machine, body, dt, towed)))
        late = round((m.t - m.fix.t) / dt) if m.fix is not None and isfinite(m.fix.t) else 0
        first = state.references is None and m.quality != Quality.FIX
        if m.fix is None or first or not 0 <= late < len(state.sums):
            return state
        return state._with_fix(state.sums[-1 - late], m.fix, m, dt, HITCH_SIGMA * towed.antenna)

    def _with_fix(self, at: Sums, fix: Fix, m: Measurement, dt: float, swing: float) -> "Reckoning":
        """Return the state after checking a fix; `swing` is the antenna's position error due to the hitch angle [m]."""
        place = complex(fix.x, fix.y)
        if self.checked is None:
            return self._replace(checked=at, begun_at=place)
        if self.references is None:
            moved = at.path - self.checked.path
            if abs(moved) < START_M:
                return self
            theta = phase((place - self.begun_at) / moved)
            return self._replace(checked=at, references=References.first(at, place, theta))
        if at.t - self.checked.t < EPOCH_S - 0.5 * dt:
            return self
        has_tilt = isfinite(m.roll + m.pitch)
        tilt_error = (TILT_SIGMA if has_tilt else UNKNOWN_TILT_SIGMA) + ROCKING_FACTOR * at.rocking
        found = self.references.predicted(self.checked, at)
        fixed = m.quality == Quality.FIX
        error = POSITION_SIGMA if fixed else LOOSE_SIGMA
        found, distance, sigma = found.checked(
            at, fix, error**2 + tilt_error**2 + swing**2, 1.0 if fixed else LOOSE_FIXES
        )
        if isfinite(fix.heading):
            found = found.turned(_heading(m) - at.phi)
        return self._replace(checked=at, references=found.renewed(at.t), distance=distance, sigma=sigma)
