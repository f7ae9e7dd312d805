"""Size of a field about the origin: a square by `half_size_m`, or a rectangle by `size_m`."""

from math import ceil
from typing import Annotated, Self

from pydantic import Field, model_validator

from agrobot_mj.core.spec import HUGE, Positive, Spec
from agrobot_mj.terrain.grid import MOST_STEPS

Side = Annotated[float, Field(gt=0, le=2 * HUGE)]


class Sized(Spec):
    """A terrain whose field has its own size; exactly one of the two keys holds."""

    half_size_m: Positive | None = 500.0
    """Distance from the origin to each edge of a square field [m]."""
    size_m: tuple[Side, Side] | None = None
    """Size of a rectangular field about the origin, east by north, instead of `half_size_m` [m]."""

    @model_validator(mode="after")
    def _has_one_size(self) -> Self:
        if self.size_m is not None and "half_size_m" not in self.model_fields_set:
            # The rectangle takes the place of the default, for good: the resolved scenario shall not have both.
            object.__setattr__(self, "half_size_m", None)
        if self.half_size_m is not None and self.size_m is not None:
            raise ValueError("size_m: stands beside half_size_m; leave one of them out")
        if self.half_size_m is None and self.size_m is None:
            raise ValueError("half_size_m: has no value; give it, or size_m = [east, north]")
        if self.size_m is not None and max(self.size_m) > MOST_STEPS * min(self.size_m):
            raise ValueError(f"size_m: one side is more than {MOST_STEPS} times the other; make it longer")
        return self

    @property
    def half_sizes(self) -> tuple[float, float]:
        """Distances from the origin to the eastern and to the northern edge [m]."""
        if self.size_m is not None:
            return self.size_m[0] / 2, self.size_m[1] / 2
        assert self.half_size_m is not None  # checked when the spec was made
        return self.half_size_m, self.half_size_m


def cells_of(half_sizes: tuple[float, float], largest: float) -> tuple[int, int]:
    """Cells to the east and to the north of a grid with square cells of at most `largest` [m].

    The longer side is divided evenly; the shorter one has as many of these cells as cover it.
    """
    longer, shorter = max(half_sizes), min(half_sizes)
    most = max(1, ceil(2 * longer / largest - 1e-9))
    fewest = max(1, ceil(most * shorter / longer - 1e-9))
    return (most, fewest) if half_sizes[0] >= half_sizes[1] else (fewest, most)
