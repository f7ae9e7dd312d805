"""RTK-GNSS receiver: position and velocity of the antenna, which moves with roll and pitch.

The position error of each axis is white noise plus first-order Gauss-Markov parts [Brown2012]; the velocity error is
white noise. A float solution has separate position errors. A solution without corrections (the fault `gnss_dgps`) has
the errors of a fix plus the offset of the fault. The default is the paper's 2 cm, mostly white. Real receivers have
millimetres of white noise and a drift of a centimetre over minutes, modelled by `multipath` and `drift`. Solutions are
in ENU [m, m/s]; their latency is in whole ticks.
"""

from math import nan, sqrt
from typing import Annotated, NamedTuple

from pydantic import AfterValidator, Field

from agrobot_mj.core.randomness import GaussMarkov, stream
from agrobot_mj.core.signals import TICK_S, Column, Conditions, Fix, Frozen, Quality, Truth, worse
from agrobot_mj.core.spec import Fraction, Latency, NonNegative, Positive
from agrobot_mj.sensors.base import Sensor
from agrobot_mj.sensors.canopy import Canopy, CanopyState
from agrobot_mj.sensors.dual_antenna import DualAntenna, DualAntennaState


def _whole_ticks_apart(rate_hz: float) -> float:
    """Return `rate_hz` unchanged. Raises ValueError unless solutions are a whole number of ticks apart."""
    ticks = 1.0 / (rate_hz * TICK_S)
    if abs(ticks - round(ticks)) > 1e-9 * ticks:
        raise ValueError(f"must give a period of whole ticks of {TICK_S:g} s, got {rate_hz:g}; try 20, 10 or 5")
    return rate_hz


class GnssReading(NamedTuple):
    """Solution delivered in one tick."""

    fix: Fix | None
    """Position and velocity; None without a solution."""
    quality: int
    """Quality, a constant of `Quality`."""


class FixErrors(NamedTuple):
    """Correlated position errors, divided by their standard deviations."""

    fixed: GaussMarkov
    """Error of a fixed solution, east and north; its random stream also provides the white noise."""
    floating: GaussMarkov
    """Error of a float solution, east and north."""
    height: GaussMarkov
    """Height errors of a fixed and a float solution; the random stream also provides the white noise."""
    multipath: GaussMarkov
    """Additional multipath error of a fixed solution, east, north and up."""
    drift: GaussMarkov
    """Additional slower error of a fixed solution, east, north and up."""


class GnssState(NamedTuple):
    """State of the receiver between two ticks."""

    errors: FixErrors
    dual: DualAntennaState
    canopies: tuple[CanopyState, ...]
    """State of each canopy."""
    pending: tuple[GnssReading, ...] = ()
    """Solutions in transit, one per tick, oldest first."""
    last: Fix | None = None
    """Last computed solution, which a frozen receiver repeats; None before the first one."""


class Gnss(Sensor):
    """RTK-GNSS receiver; `[sensors.gnss]`."""

    sigma_m: NonNegative = 0.02
    """Horizontal position error per axis, standard deviation of white plus correlated part [m]. Paper, section V-A."""
    float_sigma_m: NonNegative = 0.3
    """Horizontal position error of a float solution per axis, standard deviation [m]. Assumed value (0.2-0.5)."""
    correlated_fraction: Fraction = 0.3
    """Correlated fraction of the error variance [-]. Assumed value (0.2-0.6: multipath, atmosphere)."""
    correlation_time_s: Positive = 30.0
    """Correlation time of the error [s]. Assumed value (ten seconds to minutes: multipath)."""
    float_correlated_fraction: Fraction = 0.9
    """Correlated fraction of the float error variance [-]. Assumed value (0.7-1): ambiguities converge together."""
    float_correlation_time_s: Positive = 120.0
    """Correlation time of the float error [s]. Assumed value (minutes: the ambiguities converge)."""
    multipath_sigma_m: NonNegative = 0.0
    """Additional Gauss-Markov error of a fix, horizontal, per axis, standard deviation [m]. Assumed value: none;
    0.004-0.008 in the field."""
    multipath_time_s: Positive = 115.0
    """Correlation time of the multipath error [s]. Assumed value: carrier phase, baselines up to 10 km [Miller2012]."""
    drift_sigma_m: NonNegative = 0.0
    """Additional slow Gauss-Markov error of a fix from atmosphere and satellites, standard deviation [m]. Assumed
    value: none; 0.005-0.015 with a base station at 10-20 km."""
    drift_time_s: Positive = 900.0
    """Correlation time of the slow error [s]. Assumed value: network RTK, 13-17 min [Odolinski2012]."""
    height_ratio: NonNegative = 2.0
    """Height error divided by horizontal error per axis, in all parts [-]. Assumed value (1.5-3: no satellites
    below)."""
    velocity_sigma_m_s: NonNegative = 0.03
    """White noise of the velocity, per axis [m/s]. Assumed value (0.01-0.05: Doppler)."""
    rate_hz: Annotated[float, Field(ge=1, le=20), AfterValidator(_whole_ticks_apart)] = 20.0
    """Number of solutions per second, at intervals of whole ticks [Hz]. Assumed value (5-20 for guidance)."""
    latency_s: Latency = 0.0
    """Latency of a solution in whole ticks [s]. Assumed value: below a tick in receivers, up to 0.2 over radio."""
    dual_antenna: DualAntenna = DualAntenna()
    """Second antenna for the heading. Default: absent."""
    canopy: Annotated[tuple[Canopy, ...], Field(max_length=100)] = ()
    """Parts of the field with an obstructed sky, `[[sensors.gnss.canopy]]`."""

    @property
    def columns(self) -> tuple[Column, ...]:
        """Log columns: height, and with two antennas the heading."""
        height = Column("gnss_z", "m", "GNSS solution of the antenna, up; null without a solution", drawn=False)
        heading = Column("gnss_heading", "rad", "heading from two antennas; null without fixed ambiguities")
        return (height, heading) if self.dual_antenna.enabled else (height,)

    def init(self, seed: int) -> GnssState:
        """Return the state with errors sampled from their stationary distributions, without solutions in transit."""
        return GnssState(
            errors=FixErrors(
                fixed=GaussMarkov.stationary(stream(seed, "gnss"), 2),
                floating=GaussMarkov.stationary(stream(seed, "gnss.float"), 2),
                height=GaussMarkov.stationary(stream(seed, "gnss.height"), 2),
                multipath=GaussMarkov.stationary(stream(seed, "gnss.multipath"), 3),
                drift=GaussMarkov.stationary(stream(seed, "gnss.drift"), 3),
            ),
            dual=self.dual_antenna.init(seed),
            canopies=tuple(canopy.init(seed, k) for k, canopy in enumerate(self.canopy)),
        )

    def measure(
        self, state: GnssState, truth: Truth, conditions: Conditions, dt: float
    ) -> tuple[GnssState, GnssReading]:
        """Return the solution delivered in this tick.

        Quality and offset in `conditions` apply to the solution computed in this tick, the latency to the delivered
        one. While the latency increases nothing arrives; when it decreases, overtaken solutions are lost.
        """
        canopies, quality = self._below(state.canopies, truth, conditions.gnss_quality, dt)
        dual, heading = self.dual_antenna.measure(state.dual, truth, quality, dt, conditions.heading)
        fixed, floating, height, multipath, drift = state.errors
        errors = FixErrors(
            fixed.after(dt, self.correlation_time_s),
            floating.after(dt, self.float_correlation_time_s),
            height.after(dt, self.correlation_time_s, self.float_correlation_time_s),
            multipath.after(dt, self.multipath_time_s) if self.multipath_sigma_m else multipath,
            drift.after(dt, self.drift_time_s) if self.drift_sigma_m else drift,
        )
        white = (*fixed.generator.standard_normal(4).tolist(), height.generator.standard_normal())
        found = None
        if quality != Quality.NONE:
            found = self._fix(errors, truth, conditions, quality, white, heading)
            if conditions.gnss_frozen and state.last is not None:
                found = _frozen(found, state.last, conditions.gnss_frozen)
        due = round(truth.t / dt) % round(1.0 / (self.rate_hz * dt)) == 0
        pending = (*state.pending, GnssReading(found if due else None, quality))
        at = len(pending) - 1 - round((self.latency_s + conditions.gnss_latency_s) / dt)
        reading = pending[at] if at >= 0 else GnssReading(None, Quality.NONE)
        left = pending[at + 1 :] if at >= 0 else pending
        return GnssState(errors, dual, canopies, left, (found if due else None) or state.last), reading

    def _below(
        self, states: tuple[CanopyState, ...], truth: Truth, quality: int, dt: float
    ) -> tuple[tuple[CanopyState, ...], int]:
        """Return the canopies after a tick, and the best quality of a solution below them."""
        found = []
        for canopy, state in zip(self.canopy, states, strict=True):
            after, best = canopy.look(state, truth.antenna[0], truth.antenna[1], dt)
            quality = worse(quality, best)
            found.append(after)
        return tuple(found), quality

    def _fix(
        self,
        errors: FixErrors,
        truth: Truth,
        conditions: Conditions,
        quality: int,
        white: tuple[float, ...],
        heading: float,
    ) -> Fix:
        """Return the solution of the antenna; `white` contains the errors east, north, of both velocities, and up."""
        fixed = quality != Quality.FLOAT
        sigma = self.sigma_m if fixed else self.float_sigma_m
        share = self.correlated_fraction if fixed else self.float_correlated_fraction
        east, north = (errors.fixed if fixed else errors.floating).value
        slow, fast = sigma * sqrt(share), sigma * sqrt(1.0 - share)
        x, y, z = truth.antenna
        vx, vy, _ = truth.antenna_velocity
        (dx, dy), (dvx, dvy) = conditions.gnss_offset, conditions.gnss_velocity_offset
        more_x, more_y, more_z = self._further(errors) if fixed else (0.0, 0.0, 0.0)
        up = slow * errors.height.value[0 if fixed else 1] + fast * white[4] + more_z
        return Fix(
            x=x + dx + slow * east + fast * white[0] + more_x,
            y=y + dy + slow * north + fast * white[1] + more_y,
            vx=vx + dvx + self.velocity_sigma_m_s * white[2],
            vy=vy + dvy + self.velocity_sigma_m_s * white[3],
            t=truth.t,
            z=z + self.height_ratio * up,
            heading=heading,
        )

    def _further(self, errors: FixErrors) -> tuple[float, float, float]:
        """Return the additional errors of a fixed solution, east, north, and up before `height_ratio` [m]."""
        a, b = self.multipath_sigma_m, self.drift_sigma_m
        (m_x, m_y, m_z), (d_x, d_y, d_z) = errors.multipath.value, errors.drift.value
        return a * m_x + b * d_x, a * m_y + b * d_y, a * m_z + b * d_z

    def report(self, reading: GnssReading) -> tuple[float, ...]:
        """Return the height, and with two antennas the heading; NaN without a solution."""
        z, heading = (reading.fix.z, reading.fix.heading) if reading.fix else (nan, nan)
        return (z, heading) if self.dual_antenna.enabled else (z,)


def _frozen(fix: Fix, last: Fix, keep: Frozen) -> Fix:
    """Return the solution of a frozen receiver: the last position with the current time."""
    match keep:
        case "live_velocity":
            return fix._replace(x=last.x, y=last.y, z=last.z)
        case "velocity":
            return last._replace(t=fix.t)
    return last._replace(vx=0.0, vy=0.0, t=fix.t)
