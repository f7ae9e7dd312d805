"""Faults of the GNSS solution: missing, float, uncorrected, shifted, repeated and delayed solutions.

Sizes and durations with the source [Jones2026] were measured in the logs of docs/extensions/logs/real_machine.md.
"""

from typing import Annotated, Literal, NamedTuple

from numpy.random import Generator
from pydantic import Field

from agrobot_mj.core.randomness import GaussMarkov
from agrobot_mj.core.signals import TICK_S, Conditions, Quality, worse
from agrobot_mj.core.spec import HUGE, Latency
from agrobot_mj.faults.base import Scripted

Metres = Annotated[float, Field(ge=-1e4, le=1e4)]
Rate = Annotated[float, Field(ge=-10, le=10)]
Interval = Annotated[float, Field(ge=TICK_S, le=HUGE)]  # Time interval of at least one tick [s]


def add_offset(conditions: Conditions, east: float, north: float) -> Conditions:
    """Return the conditions with an additional position offset [m] to the east and north in the GNSS solution."""
    x, y = conditions.gnss_offset
    return conditions._replace(gnss_offset=(x + east, y + north))


class GnssLoss(Scripted):
    """Missing GNSS solution, caused by trees, a bridge or an unplugged antenna."""

    kind: Literal["gnss_loss"] = "gnss_loss"

    def apply(self, state: None, conditions: Conditions, t: float, dt: float) -> tuple[None, Conditions]:
        """Set the quality of the GNSS solution to NONE, so that there is no solution."""
        return None, conditions._replace(gnss_quality=worse(conditions.gnss_quality, Quality.NONE))


class GnssJump(Scripted):
    """Constant position offset, caused by ambiguities fixed to wrong integers or by another base station."""

    kind: Literal["gnss_jump"] = "gnss_jump"
    east_m: Metres = 0.0
    """Offset to the east [m]."""
    north_m: Metres = 1.0
    """Offset to the north [m]. Assumed value (range 0.2-5, from several wavelengths to a wrong base-station
    position)."""

    def apply(self, state: None, conditions: Conditions, t: float, dt: float) -> tuple[None, Conditions]:
        """Add the offset to the position of the GNSS solution. Quality and velocity do not change."""
        return None, add_offset(conditions, self.east_m, self.north_m)


class GnssDrift(Scripted):
    """Position offset that grows linearly, caused by outdated corrections, interference or spoofing."""

    kind: Literal["gnss_drift"] = "gnss_drift"
    east_m_s: Rate = 0.0
    """Growth rate of the offset to the east [m/s]."""
    north_m_s: Rate = 0.1
    """Growth rate of the offset to the north [m/s]. Assumed value (range 0.02-0.5)."""
    velocity: Literal["sound", "drifting"] = "sound"
    """Reported velocity: the true velocity (`sound`), or the velocity of the `drifting` position, as in spoofing."""

    def apply(self, state: None, conditions: Conditions, t: float, dt: float) -> tuple[None, Conditions]:
        """Add the offset reached at the end of the tick to the position. The quality does not change."""
        time, east, north = t + dt - self.start_s, self.east_m_s, self.north_m_s
        if self.velocity == "drifting":
            vx, vy = conditions.gnss_velocity_offset
            conditions = conditions._replace(gnss_velocity_offset=(vx + east, vy + north))
        return None, add_offset(conditions, east * time, north * time)


class GnssFrozen(Scripted):
    """Last position repeated with current time stamps, caused by crashed firmware or a stalled bus gateway."""

    kind: Literal["gnss_frozen"] = "gnss_frozen"
    keep: Literal["nothing", "velocity", "live_velocity"] = "nothing"
    """Reported velocity: zero (`nothing`), the last velocity (`velocity`) or the current velocity (`live_velocity`)."""
    quality: Literal["fix", "dgps"] = "fix"
    """Reported quality of the solution. With `dgps` and `live_velocity` the heading from two antennas remains valid, as
    observed for 37 s on a tractor at rest [Jones2026]."""

    def apply(self, state: None, conditions: Conditions, t: float, dt: float) -> tuple[None, Conditions]:
        """Freeze the reported position, select the reported velocity, and limit the quality to `quality`."""
        claimed = Quality.FIX if self.quality == "fix" else Quality.DGPS
        quality = worse(conditions.gnss_quality, claimed)
        return None, conditions._replace(gnss_frozen=self.keep, gnss_quality=quality)


class GnssDgps(Scripted):
    """Solution without carrier phases (quality 2 in GGA), caused by late or unsuitable corrections.

    The position drifts away from the fixed solution. The heading from two antennas remains valid, because it needs no
    corrections.
    """

    kind: Literal["gnss_dgps"] = "gnss_dgps"
    wander_sigma_m: Annotated[float, Field(ge=0, le=100)] = 0.15
    """Standard deviation of the position drift per axis [m] in its steady state. Assumed value (range 0.02-0.4).
    Measured drift: up to 0.59 m at rest; typically 0.05 m and at most 0.2 m after 1.4 s in motion [Jones2026]."""
    wander_time_s: Annotated[float, Field(gt=0, le=HUGE)] = 3.0
    """Correlation time of the position drift [s]. Assumed value (range 1-10)."""

    def init(self, generator: Generator) -> GaussMarkov:
        """Return an initial position drift of zero, so that the position starts at the fixed solution."""
        return GaussMarkov(generator, (0.0, 0.0))

    def apply(self, state: GaussMarkov, conditions: Conditions, t: float, dt: float) -> tuple[GaussMarkov, Conditions]:
        """Limit the quality of the solution to DGPS, advance the position drift, and add the drift to the position."""
        state = state.after(dt, self.wander_time_s)
        quality = worse(conditions.gnss_quality, Quality.DGPS)
        east, north = (self.wander_sigma_m * value for value in state.value)
        return state, add_offset(conditions._replace(gnss_quality=quality), east, north)


class GnssLatency(Scripted):
    """Increased latency of the solutions, caused by a slow radio link or a busy receiver.

    No solution arrives for `latency_s` after the start of the fault. At the end of the fault, solutions overtaken by
    newer solutions are lost.
    """

    kind: Literal["gnss_latency"] = "gnss_latency"
    latency_s: Latency = 0.2
    """Increase of the receiver latency [s], in whole ticks. Assumed value (range 0.1-0.5 over a radio link)."""

    def apply(self, state: None, conditions: Conditions, t: float, dt: float) -> tuple[None, Conditions]:
        """Increase the latency of the GNSS solutions."""
        return None, conditions._replace(gnss_latency_s=conditions.gnss_latency_s + self.latency_s)


class FloatState(NamedTuple):
    """State of the fault `GnssFloat` between two ticks."""

    generator: Generator
    floating: bool  # Whether the solution is currently float; always true without `flicker_s`
    turns_s: float  # Time of the next change between float and fix [s]
    jumps_s: float  # Time of the next jump of the offset [s]
    offset: tuple[float, float]  # Position offset [m], east and north


class GnssFloat(Scripted):
    """Float solution with a jumping position offset, as near trees or with a weak correction signal.

    The solution has the error of a float solution (`float_sigma_m` and related keys of `[sensors.gnss]`). The fault
    determines the intervals with a float solution, and adds an offset that jumps when the receiver selects other
    ambiguities. Times between jumps, and durations of float and fixed intervals, are exponentially distributed.
    """

    kind: Literal["gnss_float"] = "gnss_float"
    jump_sigma_m: Annotated[float, Field(ge=0, le=100)] = 0.15
    """Standard deviation of the offset per axis after each jump [m], in addition to the float error. Assumed value
    (range 0.1-0.3, from errors of several wavelengths of 0.19 m, distributed over the satellites)."""
    jump_interval_s: Interval = 20.0
    """Mean time between jumps [s]. Assumed value (range 5-60)."""
    flicker_s: Interval | None = None
    """Mean duration of float intervals and of fixed intervals [s], for a receiver that repeatedly loses its fix.
    Default: float at all times. Assumed value (range 0.5-10 near trees)."""

    def init(self, generator: Generator) -> FloatState:
        """Return the initial state of the fault: a float solution with a random offset."""
        turns = self.start_s + (generator.exponential(self.flicker_s) if self.flicker_s else HUGE)
        return self._jump(FloatState(generator, True, turns, 0.0, (0.0, 0.0)), self.start_s)

    def apply(self, state: FloatState, conditions: Conditions, t: float, dt: float) -> tuple[FloatState, Conditions]:
        """Limit the quality of the solution to float and add the offset, except in intervals with a fixed solution."""
        while self.flicker_s and t >= state.turns_s:
            turns = state.turns_s + state.generator.exponential(self.flicker_s)
            state = state._replace(floating=not state.floating, turns_s=turns)
            state = self._jump(state, t) if state.floating else state
        while t >= state.jumps_s:
            state = self._jump(state, state.jumps_s)
        if not state.floating:
            return state, conditions
        (x, y), (dx, dy) = conditions.gnss_offset, state.offset
        quality = worse(conditions.gnss_quality, Quality.FLOAT)
        return state, conditions._replace(gnss_quality=quality, gnss_offset=(x + dx, y + dy))

    def _jump(self, state: FloatState, t: float) -> FloatState:
        east, north = (self.jump_sigma_m * state.generator.standard_normal(2)).tolist()
        jumps = t + state.generator.exponential(self.jump_interval_s)
        return state._replace(jumps_s=jumps, offset=(east, north))
