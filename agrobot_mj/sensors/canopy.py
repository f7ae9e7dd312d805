"""Areas of the field with an obstructed view of the sky, for example below trees or between buildings.

Below the canopy the receiver has a float solution or no solution; losses of the solution form a two-state Markov chain.
After leaving the canopy the receiver has a float solution until the ambiguities are resolved. Positions are ENU
coordinates of the antenna [m].
"""

from math import inf
from typing import Annotated, Literal, NamedTuple

from numpy.random import Generator
from pydantic import Field, model_validator

from agrobot_mj.core.geometry import check_polygon, in_polygon
from agrobot_mj.core.randomness import stream
from agrobot_mj.core.signals import ROUNDING_S, TICK_S, Quality
from agrobot_mj.core.spec import HUGE, NonNegative, Spec

Place = Annotated[float, Field(ge=-HUGE, le=HUGE)]


class CanopyState(NamedTuple):
    """State of the signal reception below one canopy between two ticks."""

    generator: Generator  # Random stream of the signal losses, advanced in place
    lapsed: bool  # Whether an antenna below the canopy currently has no solution
    outside_s: float = inf
    """Time since the antenna left the canopy [s], or infinity if the antenna was never below the canopy."""


class Canopy(Spec):
    """Polygon with an obstructed view of the sky, configured by an item of `[[sensors.gnss.canopy]]`."""

    points: Annotated[tuple[tuple[Place, Place], ...], Field(min_length=3, max_length=1000)] = (
        *((-5.0, -5.0), (5.0, -5.0)),
        (0.0, 5.0),
    )
    """Corners [east, north] of the polygon, clockwise or counter-clockwise, without repeating the first corner [m]."""
    sky: Literal["float", "none"] = "float"
    """Best quality of the solution below the canopy: `float` or `none` (no solution)."""
    lapse_share: Annotated[float, Field(ge=0, le=0.95)] = 0.2
    """Fraction of the time below the canopy without a solution [-]. Assumed value (range 0-0.5; 0.5 for wet broad
    leaves)."""
    lapse_s: Annotated[float, Field(ge=TICK_S, le=HUGE)] = 2.0
    """Mean duration of a loss of the solution [s]. Assumed value (range 0.5-10, for passing a trunk or a branch at 1
    m/s)."""
    refix_s: NonNegative = 8.0
    """Duration of the float solution after leaving the canopy [s]. Assumed value (range 2-30) for ambiguity
    resolution."""

    @model_validator(mode="after")
    def _check_outline(self) -> "Canopy":
        check_polygon(self.points)
        return self

    def init(self, seed: int, index: int) -> CanopyState:
        """Return the state before the first tick; `index` is the position of the canopy in the list of the receiver."""
        generator = stream(seed, f"gnss.canopy.{index}")
        return CanopyState(generator, bool(generator.random() < self.lapse_share))

    def look(self, state: CanopyState, x: float, y: float, dt: float) -> tuple[CanopyState, int]:
        """Return the state after a tick of `dt` [s], and the best possible `Quality` of a solution at (x, y) [m]."""
        chance, leaves = state.generator.random(), dt / self.lapse_s
        enters = leaves * self.lapse_share / (1.0 - self.lapse_share)
        lapsed = chance >= leaves if state.lapsed else chance < enters
        if not in_polygon(self.points, x, y):
            outside = state.outside_s + dt
            quality = Quality.FLOAT if outside + ROUNDING_S < self.refix_s else Quality.FIX
            return CanopyState(state.generator, lapsed, outside), quality
        none = lapsed or self.sky == "none"
        return CanopyState(state.generator, lapsed, 0.0), Quality.NONE if none else Quality.FLOAT
