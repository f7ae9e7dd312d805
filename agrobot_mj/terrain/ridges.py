"""Furrows: parallel ridges of constant depth and spacing.

The height h across the furrows depends on the distance d from a crest, in units of the spacing (0.5 at a trough):

    sine:  h = (depth / 2) cos(2 pi d)
    flat:  h = +- depth / 2 on level crests and troughs, joined by flanks of half a cosine.

A wheel touches the ground at one point of its circumference (`tyres/envelope.py`): like a rigid circle it bridges
narrow furrows and rolls down into wide ones. Impacts on bumps shorter than the contact patch are too harsh, because a
real carcass would envelop these bumps.
"""

from math import cos, radians, sin
from typing import ClassVar, Literal

import numpy as np

from agrobot_mj.core.signals import Array
from agrobot_mj.core.spec import Positive
from agrobot_mj.terrain.generated import Generated, Node

LEVEL_SHARE = 0.3  # Length of a level crest, and of a level trough, divided by the spacing [-]. Assumed value.


class Ridges(Generated):
    """Terrain with parallel furrows."""

    VERTICAL: ClassVar[str] = "depth_m"

    kind: Literal["ridges"] = "ridges"
    half_size_m: Positive | None = 60.0
    node_m: Node = 0.0625
    """Maximum distance between neighbouring nodes [m]. Default: twelve nodes per furrow, for depths within 3 %."""
    depth_m: Positive = 0.1
    """Depth from crest to trough [m]. Assumed value (range 0.05-0.25) for ploughed and settled ground."""
    spacing_m: Positive = 0.75
    """Distance from crest to crest [m]. Assumed value (range 0.5-0.9) for row crops."""
    furrow_direction_deg: float = 90.0
    """Direction along the furrows [deg], counter-clockwise from east. With 90, a path to the east crosses the
    furrows."""
    offset_m: float = 0.0
    """Distance of a crest from the origin [m], positive to the right of the furrow direction."""
    profile: Literal["sine", "flat"] = "sine"
    """Cross-section of the furrows: `sine`, or `flat` with level crests and troughs, as in beds."""

    def finest(self) -> float:
        """Return the maximum node spacing [m] with which each furrow has at least eight nodes across."""
        return self.spacing_m / 8

    def bare(self, x: Array, y: Array) -> Array:
        """Return the heights of the furrows relative to their mean level [m]."""
        direction = radians(self.furrow_direction_deg)
        right = sin(direction) * x[None, :] - cos(direction) * y[:, None]
        turns = (right - self.offset_m) / self.spacing_m
        d = np.abs(turns - np.round(turns))
        if self.profile == "flat":
            d = np.clip((d - LEVEL_SHARE / 2) / (1 - 2 * LEVEL_SHARE), 0.0, 0.5)
        return self.depth_m / 2 * np.cos(2 * np.pi * d)
