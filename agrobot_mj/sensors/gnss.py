"""RTK-GNSS receiver: position and velocity of the antenna, which moves with roll and pitch.

The position error of each axis is white noise plus first-order Gauss-Markov parts [Brown2012]; the velocity error is
white noise. A float solution has separate position errors. A solution without corrections (fault `gnss_dgps`) has the
errors of a fixed solution plus the offset of the fault. The default error is 2 cm as in the paper, mostly white noise.
Real receivers have millimetres of white noise and a drift of a centimetre over minutes, modelled by the keys
`multipath_*` and `drift_*`. Solutions are in ENU [m, m/s]; their latency is a whole number of ticks.
"""

from math import nan, sqrt
from typing import Annotated, NamedTuple

from pydantic import AfterValidator, Field

from agrobot_mj.core.geometry import wrap
from agrobot_mj.core.kernels import jit
from agrobot_mj.core.lines import SignalLine
from agrobot_mj.core.randomness import (
    GaussMarkov,
    Shares,
    addresses,
    gauss_markov_step,
    normal,
    shares,
    stream,
    wandered_plane,
)
from agrobot_mj.core.signals import NOMINAL, TICK_S, Column, Conditions, Fix, Frozen, Quality, Truth, worse
from agrobot_mj.core.spec import Discrete, Fraction, Latency, NonNegative, Positive
from agrobot_mj.core.vectors import Vector
from agrobot_mj.machine.tractor import AntennaPlace
from agrobot_mj.sensors.base import Noise, SensedMotion, Sensor, motion_of
from agrobot_mj.sensors.canopy import Canopy, CanopyState
from agrobot_mj.sensors.dual_antenna import DualAntenna, DualAntennaLaw, antenna_heading

FLOAT = Quality.FLOAT


def _nearest_rate(rate_hz: float) -> float:
    """Return the solution rate [Hz] after rounding the interval between solutions, 1 / `rate_hz`, to whole ticks."""
    return 1.0 / (max(round(1.0 / (rate_hz * TICK_S)), 1) * TICK_S)


def _whole_ticks_apart(rate_hz: float) -> float:
    """Return `rate_hz`. Raises ValueError if the interval between solutions is not a whole number of ticks."""
    ticks = 1.0 / (rate_hz * TICK_S)
    if abs(ticks - round(ticks)) > 1e-9 * ticks:
        raise ValueError(f"must give a period of whole ticks of {TICK_S:g} s, got {rate_hz:g}; try 20, 10 or 5")
    return rate_hz


class GnssReading(NamedTuple):
    """GNSS solution delivered in one tick."""

    fix: Fix | None  # Position and velocity, or None if there is no solution
    quality: int  # Quality of the solution, a constant of `Quality`


class FixErrors(NamedTuple):
    """Correlated errors of the receiver, each divided by its standard deviation [-]."""

    fixed: tuple[float, float]  # Position error of a fixed solution, east and north
    floating: tuple[float, float]  # Position error of a float solution, east and north
    height: tuple[float, float]  # Height errors of a fixed and a float solution
    multipath: Vector  # Additional multipath error of a fixed solution, east, north and up
    drift: Vector  # Additional slower error of a fixed solution, east, north and up
    aside: float  # Slow error of the position of the second antenna relative to the first antenna


class Streams(NamedTuple):
    """Addresses of the random streams of `FixErrors`; the streams `fixed` and `height` also provide white noise."""

    fixed: int
    floating: int
    height: int
    multipath: int
    drift: int
    aside: int


class ErrorPart(NamedTuple):
    """Parameters of the position errors of a fixed or a float solution."""

    slow: float  # Standard deviation of the correlated position error per axis [m]
    fast: float  # Standard deviation of the white position error per axis [m]
    kept: Shares  # Weights of the last value and of white noise in the correlated error [-]


class FurtherPart(NamedTuple):
    """Parameters of an additional correlated error of a fixed solution."""

    sigma: float  # Standard deviation per axis [m], or 0 without the error
    kept: Shares  # Weights of the last value and of white noise in the additional error [-]


class GnssLaw(NamedTuple):
    """Parameters of the receiver, as numbers for compiled kernels."""

    fixed: ErrorPart
    floating: ErrorPart
    multipath: FurtherPart
    drift: FurtherPart
    height_ratio: float  # Height error divided by horizontal error per axis [-]
    velocity_sigma: float  # Standard deviation of the white velocity noise per axis [m/s]
    dual: DualAntennaLaw  # Parameters of the second antenna


class Sky(NamedTuple):
    """Reception conditions and faults that affect a GNSS solution."""

    quality: int = Quality.FIX  # Quality of the solution, a constant of `Quality`
    offset: tuple[float, float] = (0.0, 0.0)  # Offset of the reported position [m], east and north
    velocity_offset: tuple[float, float] = (0.0, 0.0)  # Offset of the reported velocity [m/s], east and north


CLEAR = Sky()
Solved = tuple[float, float, float, float, float, float]  # Fields of a `Fix` without the heading


@jit
def solution(
    p: GnssLaw, s: FixErrors, streams: Streams, motion: SensedMotion, sky: Sky
) -> tuple[FixErrors, tuple[Solved, float]]:
    """Return the correlated errors after a tick, the solution, and the heading from two antennas [rad] or NaN."""
    aside, heading = antenna_heading(p.dual, s.aside, streams.aside, motion, sky.quality)
    fixed = wandered_plane(s.fixed, p.fixed.kept, streams.fixed)
    floating = wandered_plane(s.floating, p.floating.kept, streams.floating)
    up_fixed = gauss_markov_step(s.height[0], p.fixed.kept, streams.height)
    up_floating = gauss_markov_step(s.height[1], p.floating.kept, streams.height)
    multipath = _further(p.multipath, s.multipath, streams.multipath)
    drift = _further(p.drift, s.drift, streams.drift)
    white_x, white_y = normal(streams.fixed), normal(streams.fixed)
    white_vx, white_vy = normal(streams.fixed), normal(streams.fixed)
    white_z = normal(streams.height)
    a, b = p.multipath.sigma, p.drift.sigma
    if sky.quality == FLOAT:
        part, (east, north), height, (more_x, more_y, more_z) = p.floating, floating, up_floating, (0.0, 0.0, 0.0)
    else:
        part, (east, north), height = p.fixed, fixed, up_fixed
        more_x, more_y = a * multipath[0] + b * drift[0], a * multipath[1] + b * drift[1]
        more_z = a * multipath[2] + b * drift[2]
    (x, y, z), (vx, vy, _) = motion.antenna, motion.antenna_velocity
    (dx, dy), (dvx, dvy) = sky.offset, sky.velocity_offset
    solved = (
        x + dx + part.slow * east + part.fast * white_x + more_x,
        y + dy + part.slow * north + part.fast * white_y + more_y,
        vx + dvx + p.velocity_sigma * white_vx,
        vy + dvy + p.velocity_sigma * white_vy,
        motion.t,
        z + p.height_ratio * (part.slow * height + part.fast * white_z + more_z),
    )
    return FixErrors(fixed, floating, (up_fixed, up_floating), multipath, drift, aside), (solved, heading)


@jit
def _further(p: FurtherPart, error: Vector, generator: int) -> Vector:
    if p.sigma == 0.0:
        return error
    east, north = wandered_plane((error[0], error[1]), p.kept, generator)
    return east, north, gauss_markov_step(error[2], p.kept, generator)


class Delivery(NamedTuple):
    """State of the transmission of GNSS solutions between two ticks: signal blockage, and solutions in transit."""

    canopies: tuple[CanopyState, ...]  # State of each canopy
    heading: SignalLine = SignalLine()  # Signal line that transmits the heading from two antennas
    pending: tuple[GnssReading, ...] = ()  # Solutions in transit, one per tick, oldest first
    last: Fix | None = None  # Last computed solution, which a frozen receiver repeats, or None at the start


class GnssState(NamedTuple):
    """State of the receiver between two ticks."""

    noise: Noise  # Errors (`FixErrors`) and their random streams (`Streams`)
    delivery: Delivery


class Gnss(Sensor):
    """RTK-GNSS receiver of the tractor, configured by `[sensors.gnss]`."""

    sigma_m: NonNegative = 0.02
    """Standard deviation of the sum of white and correlated horizontal errors per axis [m]. Paper, section V-A."""
    float_sigma_m: NonNegative = 0.3
    """Standard deviation of the horizontal position error of a float solution per axis [m]. Assumed value (range
    0.2-0.5)."""
    correlated_fraction: Fraction = 0.3
    """Correlated fraction of the position error variance [-]. Assumed value (range 0.2-0.6) for errors from multipath
    and the atmosphere."""
    correlation_time_s: Positive = 30.0
    """Correlation time of the correlated position error [s]. Assumed value for multipath (10 s to several minutes)."""
    float_correlated_fraction: Fraction = 0.9
    """Correlated fraction of the float error variance [-]. Assumed value (range 0.7-1) for slowly changing
    ambiguities."""
    float_correlation_time_s: Positive = 120.0
    """Correlation time of the float error [s]. Assumed value: the ambiguities converge within minutes."""
    multipath_sigma_m: NonNegative = 0.0
    """Standard deviation of an additional horizontal Gauss-Markov error of a fixed solution, per axis [m]. Default: no
    multipath error. Assumed value (range 0.004-0.008 in the field)."""
    multipath_time_s: Positive = 115.0
    """Correlation time of the multipath error [s]. Assumed value for baselines up to 10 km [Miller2012]."""
    drift_sigma_m: NonNegative = 0.0
    """Standard deviation of a slow Gauss-Markov error of a fixed solution due to the atmosphere and the satellites [m].
    Default: no drift. Assumed value (range 0.005-0.015) for a base station at 10-20 km."""
    drift_time_s: Positive = 900.0
    """Correlation time of the slow error (drift) [s]. Assumed value for network RTK (13-17 min) [Odolinski2012]."""
    height_ratio: NonNegative = 2.0
    """Ratio of height error to horizontal error per axis [-], for all position errors. Assumed value (range 1.5-3)."""
    velocity_sigma_m_s: NonNegative = 0.03
    """Standard deviation of the white velocity noise per axis [m/s]. Assumed value (range 0.01-0.05) for velocities
    computed from Doppler shifts."""
    rate_hz: Annotated[float, Field(ge=1, le=20), AfterValidator(_whole_ticks_apart), Discrete(_nearest_rate)] = 20.0
    """Number of solutions per second [Hz], at intervals of whole ticks. Assumed value (range 5-20 for guidance)."""
    latency_s: Latency = 0.0
    """Latency of a solution, in whole ticks [s]. Assumed value: below one tick in a receiver, up to 0.2 s by radio."""
    configured_ahead_m: AntennaPlace | None = None
    """Distance of the antenna ahead of the rear axle, set in the on-board computer [m]. Default: the true value."""
    configured_left_m: AntennaPlace | None = None
    """Offset of the antenna to the left, set in the on-board computer [m]. Default: the true value."""
    dual_antenna: DualAntenna = DualAntenna()
    """Second antenna for the heading. Default: absent."""
    canopy: Annotated[tuple[Canopy, ...], Field(max_length=100)] = ()
    """Parts of the field with an obstructed view of the sky, configured by `[[sensors.gnss.canopy]]`."""

    def configured_position(self, ahead: float, left: float) -> tuple[float, float]:
        """Return the distances of the antenna ahead and left of the rear axle [m] in the on-board computer, by default
        the true distances `ahead` and `left`."""
        given_ahead, given_left = self.configured_ahead_m, self.configured_left_m
        return ahead if given_ahead is None else given_ahead, left if given_left is None else given_left

    @property
    def columns(self) -> tuple[Column, ...]:
        """Log columns of the measured antenna height and, with two antennas, of the measured heading."""
        height = Column("gnss_z", "m", "GNSS solution of the antenna, up; null without a solution", drawn=False)
        heading = Column("gnss_heading", "rad", "heading from two antennas; null without fixed ambiguities")
        return (height, heading) if self.dual_antenna.enabled else (height,)

    def parameters(self, dt: float) -> GnssLaw:
        """Return the parameters of the function `solution` for ticks of length `dt` [s]."""
        fixed, floating = self.correlated_fraction, self.float_correlated_fraction
        return GnssLaw(
            fixed=_part(self.sigma_m, fixed, shares(dt, self.correlation_time_s)),
            floating=_part(self.float_sigma_m, floating, shares(dt, self.float_correlation_time_s)),
            multipath=FurtherPart(self.multipath_sigma_m, shares(dt, self.multipath_time_s)),
            drift=FurtherPart(self.drift_sigma_m, shares(dt, self.drift_time_s)),
            height_ratio=self.height_ratio,
            velocity_sigma=self.velocity_sigma_m_s,
            dual=self.dual_antenna.parameters(dt),
        )

    def init(self, seed: int) -> GnssState:
        """Return the initial state, with errors from their stationary distributions and no solutions in transit."""
        axes = {"gnss": 2, "gnss.float": 2, "gnss.height": 2, "gnss.multipath": 3, "gnss.drift": 3}
        parts = [GaussMarkov.stationary(stream(seed, name), n) for name, n in axes.items()]
        aside = GaussMarkov.stationary(stream(seed, "gnss.dual_antenna"))
        errors = FixErrors(*(part.value for part in parts), *aside.value)
        canopies = tuple(canopy.init(seed, k) for k, canopy in enumerate(self.canopy))
        return GnssState(Noise(tuple(part.generator for part in (*parts, aside)), errors), Delivery(canopies))

    def measure(
        self, state: GnssState, truth: Truth, conditions: Conditions, dt: float
    ) -> tuple[GnssState, GnssReading]:
        """Return the new state and the solution that the receiver delivers in this tick."""
        noise, delivery = state
        delivery, sky = self.sky(delivery, truth, conditions, dt)
        streams = Streams(*addresses(noise.generators))
        errors, (solved, heading) = solution(self.parameters(dt), noise.values, streams, motion_of(truth), sky)
        delivery, reading = self.deliver(delivery, Fix(*solved), heading, sky.quality, conditions, dt)
        return GnssState(noise._replace(values=errors), delivery), reading

    def sky(self, state: Delivery, truth: Truth, conditions: Conditions, dt: float) -> tuple[Delivery, Sky]:
        """Update the signal blockage by canopies; return the new state and the reception conditions at the antenna."""
        quality = conditions.gnss_quality
        if self.canopy:
            found = []
            for canopy, before in zip(self.canopy, state.canopies, strict=True):
                after, best = canopy.look(before, truth.antenna[0], truth.antenna[1], dt)
                quality = worse(quality, best)
                found.append(after)
            state = state._replace(canopies=tuple(found))
        elif conditions is NOMINAL:
            return state, CLEAR
        return state, Sky(quality, conditions.gnss_offset, conditions.gnss_velocity_offset)

    @property
    def immediate(self) -> bool:
        """Whether each tick without faults delivers a fixed solution without latency."""
        return not self.canopy and round(self.latency_s / TICK_S) == 0 and round(1.0 / (self.rate_hz * TICK_S)) == 1

    def deliver(
        self, state: Delivery, fix: Fix, heading: float, quality: int, conditions: Conditions, dt: float
    ) -> tuple[Delivery, GnssReading]:
        """Return the new state and the solution delivered in the tick in which `fix` and `heading` were computed.

        Quality and offset in `conditions` apply to the solution computed in this tick; the latency applies to the
        solution delivered in this tick. While the latency increases, no solution arrives. When the latency decreases,
        solutions overtaken by newer solutions are lost.
        """
        canopies, line, pending, last = state
        if self.dual_antenna.enabled:
            line, heading = line.transmit(heading, conditions.heading, dt)
        found = None
        if quality != Quality.NONE and round(fix.t / dt) % round(1.0 / (self.rate_hz * dt)) == 0:
            fix = fix._replace(heading=wrap(heading) if self.dual_antenna.enabled else nan)
            found = last = _frozen(fix, last, conditions.gnss_frozen) if last else fix
        reading = GnssReading(found, quality)
        late = max(round((self.latency_s + conditions.gnss_latency_s) / dt), 0)
        if late or pending:
            pending = (*pending, reading)
            at = len(pending) - 1 - late
            reading = pending[at] if at >= 0 else GnssReading(None, Quality.NONE)
            pending = pending[max(at + 1, 0) :]
        return Delivery(canopies, line, pending, last), reading

    def report(self, reading: GnssReading) -> tuple[float, ...]:
        """Return the antenna height [m] and, with two antennas, the heading [rad]; both are NaN without a solution."""
        z, heading = (reading.fix.z, reading.fix.heading) if reading.fix else (nan, nan)
        return (z, heading) if self.dual_antenna.enabled else (z,)


def _part(sigma: float, share: float, kept: Shares) -> ErrorPart:
    """Return the parameters of an error with standard deviation `sigma` [m] and correlated fraction `share` [-]."""
    return ErrorPart(sigma * sqrt(share), sigma * sqrt(1.0 - share), kept)


def _frozen(fix: Fix, last: Fix, keep: Frozen) -> Fix:
    """Return the solution `fix`, or the position of `last` at the time of `fix` if the receiver is frozen. `keep`
    selects the velocity of a frozen receiver: current, last or zero."""
    match keep:
        case "":
            return fix
        case "live_velocity":
            return fix._replace(x=last.x, y=last.y, z=last.z)
        case "velocity":
            return last._replace(t=fix.t)
    return last._replace(vx=0.0, vy=0.0, t=fix.t)
