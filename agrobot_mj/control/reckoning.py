"""Dead reckoning for the supervisor: where wheels and gyro lead from the fixes of the last 30 s.

The path of R and its derivative by the compliance C of the tyres, from wheel speed w, yaw rate r and roll, are the sums

    dq = w exp(j (phi + beta)) dt,  dh = j f dq,    phi' = r,  beta = -C f,  f = w r + g sin(roll) + p sin(gamma)

in a frame at an unknown angle, with the pull p of a working implement at the angle gamma to the tractor. A reference
has seven states: position x, y of R, angle theta of that frame, gyro bias b, wheel scale k, sideslip kappa and
compliance c beyond the modelled ones. From fix to fix

    x + j y += exp(j (theta + kappa)) ((1 - k) dq - c dh),    theta -= b dt

and all but x, y are random walks, faster in turns under a large side force f. Reference 0 follows the fixes, and the
headings of two antennas. Every 5 s a copy of it begins a further reference, which for 30 s sees no fix: a fix must fit
all of them (integrity monitoring by extrapolation [Diesel1995]). A position and a velocity that are wrong together
show in the path, a jump in a gap at once. Without gyro the heading turns the path, or else the steering angle; without
wheels, or where they spin, the speed of the fixes counts. SI units.
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
"""Least time between two fixes that are checked [s]. Assumed value."""
MEMORY_S, RENEWAL_S = 30.0, 5.0
"""Life of a reference, and time from the beginning of one to that of the next [s]. Assumed values."""
HISTORY_TICKS = 101
"""Ticks whose sums are kept: fixes are up to 5 s late."""
START_M = 1.5
"""Distance between the two fixes that show theta first [m]. Assumed value: within 3 deg."""
COMPLIANCE = radians(0.8)
"""Modelled compliance C [rad s2/m]. Assumed value: 0.5 on soil, 0.8-1 on firm ground [deg s2/m]."""
CLIMB_SLIP = 0.01
"""Modelled slip of the driven wheels per specific pull of gravity [s2/m]. Assumed value: firm ground; more on soil."""
POSITION_SIGMA, LEAN_SIGMA, UNKNOWN_LEAN_SIGMA = 0.03, 0.02, 0.06
"""Error of a fix [m], and of the antenna's place by the lean that the inertial unit does not show, or by all of it
without a unit [m]. Assumed values: 2 cm of the fix; 0.6 and 2 deg at 2 m."""
LOOSE_SIGMA, LOOSE_FIXES = 0.35, 40.0
"""Error of a fix whose quality is less than FIX [m], and number of such fixes that share it [-]. Assumed values: a
float solution, correlated over 20 s."""
HEADING_SIGMA = radians(0.35)
"""Error of a heading from two antennas [rad]. Assumed value."""
COMPASS_S = 5.0
"""Time over which that heading is compared with the gyro [s]. Assumed value: well below the drift of a gyro."""
BRIDGED_SIGMA = radians(0.15)
"""Error of the angle between path and heading once the gyro is lost [rad]. Assumed value: `HEADING_SIGMA` smoothed."""
START_SIGMAS = (0.04, 0.04, radians(3.0), radians(0.3), 0.05, radians(2.0), radians(0.25))
"""Standard deviations of the states at the start. Assumed values: two fixes, a cold gyro, worn tyres, soil."""
POSITION_WALK, ANGLE_WALK, BIAS_WALK, COMPLIANCE_WALK = 0.005, radians(0.03), radians(0.003), radians(0.01)
"""Random walks of position [m/sqrt(s)], theta [rad/sqrt(s)], b [rad/s/sqrt(s)] and c [rad s2/m/sqrt(s)]. Assumed
values: sway, noise of the gyro, warming up, ground."""
SIDESLIP_WALK, SLIP_WALK = (radians(0.04), radians(0.12)), (0.002, 0.003)
"""Random walks of kappa and k, in time [rad/sqrt(s), 1/sqrt(s)] and in turns [rad/sqrt(rad), 1/sqrt(rad)]. Assumed
values: six machines on level, rough, sloping and soft ground."""
SLIDING, UNKNOWN_FORCE = 2.4, 3.5
"""Specific pull at which both walks are twice as large, by its fourth power, and the pull that counts without an
inertial unit [m/s2]. Assumed values: tyres that begin to slide on 15 deg; unseen slopes up to 15 deg."""
DRAUGHT = 3.0
"""Specific pull of a working implement at the rear axle [m/s2]. Assumed value: draught of a sixth of the tractor's
weight (0.1-0.3), over the mass on that axle."""
SWING_SIGMA = radians(2.0)
"""Error of the modelled angle at the hitch [rad]. Assumed value: sideslip of implement and tractor."""
HOPPING = 0.3
"""Variation of the vertical specific force, over g, at which they are twice as large, too, by its fourth power [-]:
wheels whose load varies hold less side force. Assumed value: ridges of 3 cm show 0.3 at 1.8 m/s and 1 at 3 m/s, where
tractors slide by 7 deg; other ground 0.15 at most."""
ROCKING_S = 2.0
"""Time over which rocking of the antenna and vertical force are smoothed [s]. Assumed value."""
ROCKING_SHARE = 2.0
"""Error of the lean over the rocking [-]. Assumed value: half a period between a fix and the angles."""
SPEEDS_S = 1.0
"""Time over which speeds of wheels and fixes are smoothed for comparison [s]. Assumed value."""
SLIPPING = 0.97
"""Speed of the fixes over that of the wheels below which the wheels spin [-]. Assumed value."""
SPINNING = 0.9
"""That ratio below which the walk of k grows by the slip, too [-]. Assumed value: smoothed speeds lag when it
begins."""
STANDING_M_S = 0.05
"""Wheel speed below which the gyro reads its bias [m/s]. Assumed value."""
STEERED_WALK = radians(1.5)
"""Random walk of theta where the steering angle stands in for the gyro [rad/sqrt(s)]. Assumed value: 2 deg of bias at
1.2 m/s for two seconds."""
HEADING_GATE = 5.0
"""Error of a heading above which it is not used, in standard deviations [-]. Assumed value."""


class Compass(NamedTuple):
    """Heading of two antennas less phi, smoothed while there is a gyro."""

    angle: float = nan
    """NaN before the first heading [rad]."""
    rate: float = 0.0
    """Its rate, the error of the gyro with opposite sign [rad/s]."""

    def after(self, shown: float, dt: float) -> "Compass":
        """After a tick of `dt` [s] in which the difference was `shown`; NaN without a heading [rad]."""
        if not isfinite(self.angle):
            return Compass(shown)
        angle = self.angle + self.rate * dt
        if not isfinite(shown):
            return self._replace(angle=angle)
        error, share = remainder(shown - angle, tau), dt / COMPASS_S
        return Compass(angle + 2.0 * share * error, self.rate + share * share / dt * error)


class Sums(NamedTuple):
    """Sums over all ticks up to a time."""

    t: float = 0.0
    """That time [s]."""
    phi: float = 0.0
    """Integral of the yaw rate [rad]."""
    path: complex = 0j
    """q, the path of R [m]."""
    bent: complex = 0j
    """h, derivative of the path by the compliance [m2/s2]."""
    sideslip: float = 0.0
    """Variance that the walk of kappa has gained [rad2]."""
    slip: float = 0.0
    """Variance that the walk of k has gained [-]."""
    lever: complex = 0j
    """Antenna less R in the frame of the path [m]."""
    behind: complex = 0j
    """Place of an antenna on an implement less R, likewise; 0 for one on the tractor [m]."""
    rest: complex = 0j
    """Mean of the lever over `ROCKING_S` [m]."""
    rocking: float = 0.0
    """Mean distance of the lever from its mean [m]."""
    swing: float = 0.0
    """Angle gamma of a drawn implement to the tractor, from the path of the rear axle; in line in reverse [rad]."""
    hopping: float = 0.0
    """Mean variation of the vertical specific force over g, 0 without a measured force [-]."""
    wheels: float = 0.0
    """Smoothed speed of the wheels where there was a fix [m/s]."""
    fixes: float = 0.0
    """Smoothed speed of the fixes [m/s]."""
    fix_t: float = 0.0
    """Time of the last fix [s]."""
    tilt: SmoothedTilt = SmoothedTilt(0.0, 0.0)
    """Smoothed roll and pitch."""
    compass: Compass = Compass()
    """What stands in for the gyro."""
    gyro_s: float = 0.0
    """Time with a gyro, whose bias turns theta [s]."""
    turning: float = 0.0
    """Variance that theta has gained without gyro [rad2]."""
    blind: bool = False
    """Whether the gyro is missing."""

    def after(self, m: Measurement, machine: TractorParameters, body: bool, dt: float, towed: TowedImplement) -> "Sums":
        """Sums after a tick of `dt` [s]; the gyro turns about the axis of the `body` or the vertical."""
        wheels, fixes, fix_t = self._speeds(m)
        leans = isfinite(m.roll + m.pitch)
        tilt = self.tilt.after(m.roll, m.pitch, dt) if leans else self.tilt
        side, climb = (GRAVITY * sin(m.roll), GRAVITY * sin(m.pitch)) if leans else (0.0, 0.0)
        w = self._speed(m) * (cos(m.pitch) * (1.0 + CLIMB_SLIP * climb) if leans else 1.0)
        heading, seen = _heading(m), isfinite(m.gyro)
        rate, turning = self._turn(m, heading, tilt.heading_rate(m.gyro, body) if leans else m.gyro, w, machine, dt)
        phi = self.phi + rate * dt
        swing = self.swing - (rate + abs(w) * sin(self.swing) / towed.length) * dt if towed.length else 0.0
        force = w * rate + side + DRAUGHT * sin(swing) * towed.working
        step = w * dt * turn(1j * (self.phi + 0.5 * rate * dt - COMPLIANCE * force))
        lever = machine.antenna_height_m * complex(sin(m.pitch), -sin(m.roll)) * turn(1j * phi) if leans else self.lever
        rest = self.rest + (lever - self.rest) * dt / ROCKING_S
        pull = hypot(force, climb) if leans else UNKNOWN_FORCE
        growth = (1.0 + (pull / SLIDING) ** 4 + (self.hopping / HOPPING) ** 4) ** 2
        weight = getattr(m.readings.get("imu"), "force_z", nan) / GRAVITY
        varied = abs(weight - 1.0) if isfinite(weight) else 0.0
        return Sums(
            t=m.t,
            phi=phi,
            path=self.path + step,
            bent=self.bent + 1j * force * step,
            sideslip=self.sideslip + growth * _walked(SIDESLIP_WALK, rate, dt),
            slip=self.slip + growth * _walked(SLIP_WALK, rate, dt) + self._spinning() ** 2 * dt,
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
        """Yaw rate at a speed `w` [m/s], and the variance that theta gains: by gyro, two antennas or steering angle."""
        standing = abs(w) < STANDING_M_S
        if isfinite(m.gyro):
            return (0.0 if standing else gyro), 0.0
        lost = 0.0 if self.blind else BRIDGED_SIGMA**2
        if isfinite(heading + self.compass.angle):
            return remainder(heading - self.compass.angle - self.phi, tau) / dt, lost
        rate = 0.0 if standing else w * tan(m.steer) / machine.wheelbase_m
        return rate, STEERED_WALK**2 * dt + lost

    def _speed(self, m: Measurement) -> float:
        """Speed of R: that of the wheels as far as they do not spin, of the last fixes without wheels [m/s]."""
        if not isfinite(m.wheel_speed):
            return copysign(self.fixes, m.pedal)
        spinning = self.fixes < SLIPPING * self.wheels
        return m.wheel_speed * self.fixes / (SLIPPING * self.wheels) if spinning else m.wheel_speed

    def _spinning(self) -> float:
        """Slip that is more than a scale error [-]."""
        return max(1.0 - self.fixes / (SPINNING * self.wheels), 0.0) if self.wheels > STANDING_M_S else 0.0

    def _speeds(self, m: Measurement) -> tuple[float, float, float]:
        """Smoothed speeds of wheels and fixes, and the time of the last fix."""
        if m.fix is None:
            return self.wheels, self.fixes, self.fix_t
        share = min((m.t - self.fix_t) / SPEEDS_S, 1.0)
        fixes = self.fixes + share * (hypot(m.fix.vx, m.fix.vy) - self.fixes)
        wheels = self.wheels + share * (abs(m.wheel_speed) - self.wheels) if isfinite(m.wheel_speed) else fixes
        return wheels, fixes, m.t


def _heading(m: Measurement) -> float:
    """Heading of two antennas, without what the lean of the tractor adds; NaN without one [rad]."""
    if m.fix is None:
        return nan
    return m.fix.heading + (atan(sin(m.pitch) * tan(m.roll)) if isfinite(m.roll + m.pitch) else 0.0)


def _walked(walk: tuple[float, float], rate: float, dt: float) -> float:
    """Variance that a walk gains in a tick of `dt` [s] at a yaw rate [rad/s]."""
    return (walk[0] ** 2 + walk[1] ** 2 * abs(rate)) * dt


class References(NamedTuple):
    """All references at the time of the last checked fix; the first follows the fixes."""

    means: Array
    """x, y, theta, b, k, kappa and c, shape (n, 7)."""
    covariances: Array
    """Shape (n, 7, 7)."""
    begun: tuple[float, ...]
    """Time from which on each has seen no fix [s]."""

    @classmethod
    def first(cls, at: Sums, place: complex, theta: float) -> "References":
        """The first one, from a fix at `place` [m] and an angle theta [rad]."""
        foot = place - turn(1j * theta) * (at.lever + at.behind)
        mean = np.array([[foot.real, foot.imag, theta, 0.0, 0.0, 0.0, 0.0]])
        return cls(mean, np.diag(np.square(START_SIGMAS))[None], (at.t,))

    def predicted(self, last: Sums, at: Sums) -> "References":
        """Means and covariances led on between two sums."""
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
        """The references after a fix whose position has this `variance` [m2], an error that so many are `sharing`, with
        its distance from the one that it contradicts most and the standard deviation of that distance [m]."""
        foot = complex(fix.x, fix.y) - np.exp(1j * self.means[:, 2]) * (at.lever + at.behind)
        off = np.stack((foot.real, foot.imag), axis=1) - self.means[:, :2]
        S = self.covariances[:, :2, :2] + variance * np.eye(2)
        nis = np.einsum("ni,nij,nj->n", off, np.linalg.inv(S), off)
        worst = int(np.argmax(nis))
        apart = hypot(*off[worst].tolist())
        followed = self._corrected(np.eye(2, 7), off[0], S[0] + (sharing - 1.0) * variance * np.eye(2))
        return followed, apart, apart / sqrt(nis[worst]) if nis[worst] > 0.0 else sqrt(variance)

    def turned(self, heading: float) -> "References":
        """The references after the difference of heading and phi [rad], unless it is improbable."""
        error = remainder(heading - float(self.means[0, 2]), tau)
        S = float(self.covariances[0, 2, 2]) + HEADING_SIGMA**2
        if error * error > HEADING_GATE**2 * S:
            return self
        return self._corrected(np.eye(1, 7, 2), np.array([error]), np.array([[S]]))

    def _corrected(self, H: Array, innovation: Array, S: Array) -> "References":
        """With the first one corrected by a measurement."""
        means, P = self.means.copy(), self.covariances.copy()
        gain = P[0] @ H.T @ np.linalg.inv(S)
        means[0] += gain @ innovation
        P[0] -= gain @ H @ P[0]
        return self._replace(means=means, covariances=P)

    def renewed(self, t: float) -> "References":
        """Without those that are too old at `t` [s], and with a new one where it is due."""
        keep = [0, *(n for n, begun in enumerate(self.begun) if n and t - begun < MEMORY_S)]
        begun = tuple(self.begun[n] for n in keep)
        if t - begun[-1] > RENEWAL_S:
            keep, begun = [*keep, 0], (*begun, t)
        return References(self.means[keep], self.covariances[keep], begun)


class Reckoning(NamedTuple):
    """Dead reckoning between two ticks."""

    sums: tuple[Sums, ...] = (Sums(),)
    """Sums of the last ticks, oldest first."""
    checked: Sums | None = None
    """Sums at the last checked fix; None before the first fix."""
    begun_at: complex = 0j
    """Place of the first fix [m]."""
    references: References | None = None
    """Where dead reckoning leads to; None before theta is known."""
    apart: float = nan
    """Distance of the last checked fix from the reference that it contradicts most; NaN before [m]."""
    sigma: float = nan
    """Standard deviation of that distance; NaN before [m]."""

    def after(
        self, m: Measurement, machine: TractorParameters, body: bool, dt: float, towed: TowedImplement
    ) -> "Reckoning":
        """Dead reckoning after a tick of `dt` [s], with a gyro as in `Sums.after`; it begins with the first reading of
        one, and bridges its loss by heading or steering angle."""
        if self.checked is None and not isfinite(m.gyro):
            return self
        state = self._replace(sums=(*self.sums[1 - HISTORY_TICKS :], self.sums[-1].after(m, machine, body, dt, towed)))
        late = round((m.t - m.fix.t) / dt) if m.fix is not None and isfinite(m.fix.t) else 0
        first = state.references is None and m.quality != Quality.FIX
        if m.fix is None or first or not 0 <= late < len(state.sums):
            return state
        return state._seen(state.sums[-1 - late], m.fix, m, dt, SWING_SIGMA * towed.antenna)

    def _seen(self, at: Sums, fix: Fix, m: Measurement, dt: float, swing: float) -> "Reckoning":
        """After a fix that was taken at these sums, of an antenna that swings at the hitch by `swing` [m]."""
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
        leans = isfinite(m.roll + m.pitch)
        lean = (LEAN_SIGMA if leans else UNKNOWN_LEAN_SIGMA) + ROCKING_SHARE * at.rocking
        found = self.references.predicted(self.checked, at)
        fixed = m.quality == Quality.FIX
        error = POSITION_SIGMA if fixed else LOOSE_SIGMA
        found, apart, sigma = found.checked(at, fix, error**2 + lean**2 + swing**2, 1.0 if fixed else LOOSE_FIXES)
        if isfinite(fix.heading):
            found = found.turned(_heading(m) - at.phi)
        return self._replace(checked=at, references=found.renewed(at.t), apart=apart, sigma=sigma)
