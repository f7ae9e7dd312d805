"""RTK float: the carrier ambiguities are not fixed, beside trees or with a weak correction signal.

The receiver itself has the error of a float solution (`float_sigma_m` and what belongs to it in `[sensors.gnss]`);
this fault says when solutions float, and adds an offset to them that jumps whenever the receiver settles on other
ambiguities. Times between jumps, and the dwells of a flicker, are exponentially distributed.
"""

from typing import Annotated, Literal, NamedTuple

from numpy.random import Generator
from pydantic import Field

from agrobot_mj.core.signals import TICK_S, Conditions, Quality
from agrobot_mj.core.spec import HUGE
from agrobot_mj.faults.base import Scripted

Interval = Annotated[float, Field(ge=TICK_S, le=HUGE)]
"""Time of at least one tick [s]."""


class FloatState(NamedTuple):
    """The fault between two ticks."""

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
    """Solutions of quality float, with offsets that jump."""

    kind: Literal["gnss_float"] = "gnss_float"
    jump_sigma_m: Annotated[float, Field(ge=0, le=100)] = 0.15
    """Standard deviation of the offset that each new set of ambiguities brings, per axis, beside the float error [m].
    Estimate (0.1-0.3: a few wavelengths of 0.19 m, shared out between satellites)."""
    jump_interval_s: Interval = 20.0
    """Mean time between jumps [s]. Estimate (5-60)."""
    flicker_s: Interval | None = None
    """Mean dwell in float, and in fix, of a receiver that keeps losing its fix beside trees [s]. It floats all the time
    when left out. Estimate where it is set (0.5-10)."""

    def init(self, generator: Generator) -> FloatState:
        """Floating from the start, with a first offset."""
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
        quality = min(conditions.gnss_quality, Quality.FLOAT)
        return state, conditions._replace(gnss_quality=quality, gnss_offset=(x + dx, y + dy))

    def _jump(self, state: FloatState, t: float) -> FloatState:
        """New ambiguities from `t` [s] on."""
        east, north = (self.jump_sigma_m * state.generator.standard_normal(2)).tolist()
        jumps = t + state.generator.exponential(self.jump_interval_s)
        return state._replace(jumps_s=jumps, offset=(east, north))
