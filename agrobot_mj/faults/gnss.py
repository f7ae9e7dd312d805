"""Faults of the GNSS receiver's solution: missing, floating, without corrections, offset, repeated or late.

Sizes and durations of [Jones2026] are those of the logs in docs/extensions/logs/real_machine.md.
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
Interval = Annotated[float, Field(ge=TICK_S, le=HUGE)]
"""Time of at least one tick [s]."""


def shifted(conditions: Conditions, east: float, north: float) -> Conditions:
    """Return the conditions with the position farther east and north [m]."""
    x, y = conditions.gnss_offset
    return conditions._replace(gnss_offset=(x + east, y + north))


class GnssLoss(Scripted):
    """No solution at all: trees, a bridge, an unplugged antenna."""

    kind: Literal["gnss_loss"] = "gnss_loss"

    def apply(self, state: None, conditions: Conditions, t: float, dt: float) -> tuple[None, Conditions]:
        """Withhold the solution."""
        return None, conditions._replace(gnss_quality=worse(conditions.gnss_quality, Quality.NONE))


class GnssJump(Scripted):
    """Constant offset of the position: ambiguities fixed to wrong integers, another base station."""

    kind: Literal["gnss_jump"] = "gnss_jump"
    east_m: Metres = 0.0
    """Offset east [m]."""
    north_m: Metres = 1.0
    """Offset north [m]. Assumed value (0.2-5: some wavelengths, a base station entered wrongly)."""

    def apply(self, state: None, conditions: Conditions, t: float, dt: float) -> tuple[None, Conditions]:
        """Shift the position; quality and velocity remain those of a valid solution."""
        return None, shifted(conditions, self.east_m, self.north_m)


class GnssDrift(Scripted):
    """Offset of the position that grows evenly: corrections of an old epoch, interference, spoofing."""

    kind: Literal["gnss_drift"] = "gnss_drift"
    east_m_s: Rate = 0.0
    """Rate east [m/s]."""
    north_m_s: Rate = 0.1
    """Rate north [m/s]. Assumed value (0.02-0.5)."""
    velocity: Literal["sound", "drifting"] = "sound"
    """Reported velocity: the `sound` one, or that of the `drifting` position, as under spoofing."""

    def apply(self, state: None, conditions: Conditions, t: float, dt: float) -> tuple[None, Conditions]:
        """Shift the position by the offset at the end of the tick; the quality remains that of a valid solution."""
        time, east, north = t + dt - self.start_s, self.east_m_s, self.north_m_s
        if self.velocity == "drifting":
            vx, vy = conditions.gnss_velocity_offset
            conditions = conditions._replace(gnss_velocity_offset=(vx + east, vy + north))
        return None, shifted(conditions, east * time, north * time)


class GnssFrozen(Scripted):
    """Repeated last position with current time stamps: hung firmware, a stalled bus gateway."""

    kind: Literal["gnss_frozen"] = "gnss_frozen"
    keep: Literal["nothing", "velocity", "live_velocity"] = "nothing"
    """Reported velocity: `nothing` for standstill, the last `velocity`, or the `live_velocity`."""
    quality: Literal["fix", "dgps"] = "fix"
    """Reported quality; with `dgps` and `live_velocity` the heading of two antennas stays fixed, as for 37 s of a
    tractor at rest [Jones2026]."""

    def apply(self, state: None, conditions: Conditions, t: float, dt: float) -> tuple[None, Conditions]:
        """Freeze the solution."""
        claimed = Quality.FIX if self.quality == "fix" else Quality.DGPS
        quality = worse(conditions.gnss_quality, claimed)
        return None, conditions._replace(gnss_frozen=self.keep, gnss_quality=quality)


class GnssDgps(Scripted):
    """Solution without carrier phases, 2 in GGA: the corrections are late or do not fit.

    The position wanders off from the fixed one. The heading of two antennas, which need no base station, continues.
    """

    kind: Literal["gnss_dgps"] = "gnss_dgps"
    wander_sigma_m: Annotated[float, Field(ge=0, le=100)] = 0.15
    """Standard deviation of the wander, per axis, once it has grown [m]. Assumed value (0.02-0.4: up to 0.59 off at
    rest,
    0.05 and up to 0.2 at the end of 1.4 s while driving [Jones2026])."""
    wander_time_s: Annotated[float, Field(gt=0, le=HUGE)] = 3.0
    """Correlation time of the wander [s]. Assumed value (1-10)."""

    def init(self, generator: Generator) -> GaussMarkov:
        """Return no wander at the start: the solution lies on the fixed one."""
        return GaussMarkov(generator, (0.0, 0.0))

    def apply(self, state: GaussMarkov, conditions: Conditions, t: float, dt: float) -> tuple[GaussMarkov, Conditions]:
        """Degrade the solution, and move on with the wander."""
        state = state.after(dt, self.wander_time_s)
        quality = worse(conditions.gnss_quality, Quality.DGPS)
        east, north = (self.wander_sigma_m * value for value in state.value)
        return state, shifted(conditions._replace(gnss_quality=quality), east, north)


class GnssLatency(Scripted):
    """Solutions arrive later than usual: a slow radio link, a busy receiver.

    Nothing arrives while the latency sets in; when it ends, the solutions that newer ones have overtaken are lost.
    """

    kind: Literal["gnss_latency"] = "gnss_latency"
    latency_s: Latency = 0.2
    """Latency in addition to that of the receiver, in whole ticks [s]. Assumed value (0.1-0.5 over a radio link)."""

    def apply(self, state: None, conditions: Conditions, t: float, dt: float) -> tuple[None, Conditions]:
        """Delay the delivered solutions."""
        return None, conditions._replace(gnss_latency_s=conditions.gnss_latency_s + self.latency_s)


class FloatState(NamedTuple):
    """A `GnssFloat` between two ticks."""

    generator: Generator
    """Random stream; advances in place."""
    floating: bool
    """Whether the ambiguities float now; they always do without a flicker."""
    turns_s: float
    """Time of the flicker's next change [s]."""
    jumps_s: float
    """Time of the offset's next jump [s]."""
    offset: tuple[float, float]
    """Offset east and north [m]."""


class GnssFloat(Scripted):
    """Solutions of quality float, with jumping offsets: next to trees, or with a weak correction signal.

    The receiver has the error of a float solution (`float_sigma_m` and related keys of `[sensors.gnss]`). This fault
    defines when solutions float, and adds an offset that jumps whenever the receiver fixes other ambiguities. Times
    between jumps, and the dwell times of a flicker, are exponentially distributed.
    """

    kind: Literal["gnss_float"] = "gnss_float"
    jump_sigma_m: Annotated[float, Field(ge=0, le=100)] = 0.15
    """Standard deviation of the offset of each new set of ambiguities, per axis, in addition to the float error [m].
    Assumed value (0.1-0.3: a few wavelengths of 0.19 m, distributed over the satellites)."""
    jump_interval_s: Interval = 20.0
    """Mean time between jumps [s]. Assumed value (5-60)."""
    flicker_s: Interval | None = None
    """Mean dwell time in float, and in fix, of a receiver that repeatedly loses its fix near trees [s]. Default: float
    all the time. Assumed value if set (0.5-10)."""

    def init(self, generator: Generator) -> FloatState:
        """Return the floating from the start, with a first offset."""
        turns = self.start_s + (generator.exponential(self.flicker_s) if self.flicker_s else HUGE)
        return self._jump(FloatState(generator, True, turns, 0.0, (0.0, 0.0)), self.start_s)

    def apply(self, state: FloatState, conditions: Conditions, t: float, dt: float) -> tuple[FloatState, Conditions]:
        """Degrade the solution to float, unless the flicker has a fix or another fault is worse."""
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
        """Return the new ambiguities from `t` [s] on."""
        east, north = (self.jump_sigma_m * state.generator.standard_normal(2)).tolist()
        jumps = t + state.generator.exponential(self.jump_interval_s)
        return state._replace(jumps_s=jumps, offset=(east, north))
