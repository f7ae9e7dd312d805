"""Base classes of terrains: size of the field, height grid with ground patches, and a tilted plane."""

from functools import lru_cache
from math import ceil, cos, radians, sin, tan
from typing import Annotated, Self

import numpy as np
from pydantic import Field, model_validator

from agrobot_mj.core.contracts import check_type
from agrobot_mj.core.resources import stamp as file_stamp
from agrobot_mj.core.spec import HUGE, Positive, Spec
from agrobot_mj.terrain.grid import MOST_STEPS, NOTHING_SPECIAL, Ground
from agrobot_mj.terrain.patches import Base, GroundPatch, surface
from agrobot_mj.terrain.variation import SurfaceName, Variation, named_surface

Side = Annotated[float, Field(gt=0, le=2 * HUGE)]


class Sized(Spec):
    """Base class of terrains with a configurable field size, given by either `half_size_m` or `size_m`."""

    half_size_m: Positive | None = 500.0
    """Distance from the origin to each edge of a square field [m]."""
    size_m: tuple[Side, Side] | None = None
    """Size of a rectangular field centred at the origin, (east, north) [m], in place of `half_size_m`."""

    @model_validator(mode="after")
    def _check_field_size(self) -> Self:
        if self.size_m is not None and "half_size_m" not in self.model_fields_set:
            # the rectangle replaces the default permanently: the resolved scenario must not contain both
            object.__setattr__(self, "half_size_m", None)
        if self.half_size_m is not None and self.size_m is not None:
            raise ValueError("size_m: cannot be combined with half_size_m; omit one key")
        if self.half_size_m is None and self.size_m is None:
            raise ValueError("half_size_m: the value is missing; set it, or set size_m = [east, north]")
        if self.size_m is not None and max(self.size_m) > MOST_STEPS * min(self.size_m):
            raise ValueError(f"size_m: one side is more than {MOST_STEPS} times the other; lengthen the shorter side")
        return self

    @property
    def half_sizes(self) -> tuple[float, float]:
        """Distances from the origin to the eastern edge and to the northern edge of the field [m]."""
        if self.size_m is not None:
            return self.size_m[0] / 2, self.size_m[1] / 2
        assert self.half_size_m is not None  # checked by the validator
        return self.half_size_m, self.half_size_m


def cells_of(half_sizes: tuple[float, float], largest: float) -> tuple[int, int]:
    """Return the numbers of square cells to the east and north in a field, with sides of at most `largest` [m]."""
    longer, shorter = max(half_sizes), min(half_sizes)
    most = max(1, ceil(2 * longer / largest - 1e-9))
    fewest = max(1, ceil(most * shorter / longer - 1e-9))
    return (most, fewest) if half_sizes[0] >= half_sizes[1] else (fewest, most)


STEEPEST_DEG = 60.0
"""Maximum accepted slope between neighbouring nodes [deg]. Assumed value: tractors cannot work on steeper ground."""
Grade = Annotated[float, Field(ge=0, lt=45)]


class Landscape(Spec):
    """Base class of all terrains; subclasses override `relief`, which returns the height grid."""

    kind: str
    patch: Annotated[tuple[GroundPatch, ...], Field(max_length=1000)] = ()
    """Ground patches with separate properties. Where patches overlap, the last patch in the list applies."""
    surface: SurfaceName | None = None
    """Named surface outside the patches: friction, cone index and rolling resistance. Default: from `plant.tyre`."""
    variation: Variation = Variation()
    """Random variation of cone index, friction and moisture outside the patches. Default: none."""

    def relief(self) -> Ground:
        """Return the height grid without the ground patches. Raises a ValueError that names an invalid key."""
        raise NotImplementedError

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences about the data read from a file, for hints."""
        return ()

    def stamp(self) -> tuple[object, ...]:
        """Return a cache key, which changes when a height file or the image file of a patch changes."""
        return tuple(file_stamp(part.file) for part in (self, *self.patch) if hasattr(part, "file"))

    def ground(self) -> Ground:
        """Return the height grid with all ground properties. Raises a ValueError that names an invalid key."""
        return _ground(self, self.stamp())


class Tilted(Landscape):
    """Base class of terrains whose heights are relative to a tilted plane.

    The plane rises by `grade_deg` towards `direction_deg` and has height zero at the origin.
    """

    grade_deg: Grade = 0.0
    """Inclination of the plane [deg]."""
    direction_deg: float = 90.0
    """Direction of steepest ascent [deg], counter-clockwise from east."""

    @property
    def gradient(self) -> tuple[float, float]:
        """Slopes (dh/dx, dh/dy) of the tilted plane to the east and north [-]."""
        grade, direction = tan(radians(self.grade_deg)), radians(self.direction_deg)
        return grade * cos(direction), grade * sin(direction)

    def tilt(self, ground: Ground) -> Ground:
        """Return a copy of `ground` with the heights of the tilted plane added to the height grid."""
        rows, columns = ground.heights.shape
        x = ground.x0 + ground.spacing * np.arange(columns)
        y = ground.y0 + ground.spacing * np.arange(rows)
        grade_x, grade_y = self.gradient
        heights = ground.heights + grade_x * x[None, :] + grade_y * y[:, None]
        return ground._replace(heights=np.ascontiguousarray(heights))


@lru_cache(maxsize=4)
def _ground(landscape: Landscape, stamp: tuple[object, ...]) -> Ground:
    relief = check_type(landscape.relief(), Ground, "the terrain", landscape.kind, "relief")
    heights = np.asarray(relief.heights)
    if heights.ndim != 2 or min(heights.shape) < 2 or not np.isfinite(heights).all():
        raise ValueError("relief: the heights must be finite numbers in at least two rows and two columns")
    base = Base(named_surface(landscape.surface), landscape.variation if landscape.variation.active else None)
    if base.variation is None and not landscape.patch:
        uniform = NOTHING_SPECIAL._replace(elsewhere=base.properties)
        return relief if landscape.surface is None else relief._replace(surface=uniform)
    return relief._replace(surface=surface(landscape.patch, relief.extent, base))
