"""Furrows: parallel ridges of one depth and one spacing.

Across the furrows the height is, with d the distance from a crest over the spacing (0 at a crest, 0.5 at a trough),

    sine:  h = (depth / 2) cos(2 pi d)
    flat:  h = +- depth / 2 on level crests and troughs, joined by flanks of half a cosine.

A wheel touches the ground in one point of its circumference (`tyres/envelope.py`): as a rigid circle it bridges furrows
that are narrower than itself, and rolls down into wider ones. Bumps shorter than its contact patch, around which a real
carcass would wrap, act too hard.
"""

from math import cos, radians, sin
from typing import ClassVar, Literal

import numpy as np

from agrobot_mj.core.signals import Array
from agrobot_mj.core.spec import Positive
from agrobot_mj.terrain.generated import Generated, Node

LEVEL_SHARE = 0.3
"""Fraction of the spacing that is level on a flat crest, and again in a trough [-]. Assumed value."""


class Ridges(Generated):
    """Furrows across or along the path."""

    VERTICAL: ClassVar[str] = "depth_m"

    kind: Literal["ridges"] = "ridges"
    half_size_m: Positive | None = 60.0
    node_m: Node = 0.0625
    """Maximum distance between nodes of the grid [m]. Twelve nodes per furrow keep the depth right within 3 %."""
    depth_m: Positive = 0.1
    """Depth from crest to trough [m]. Assumed value: ploughed and settled ground; 0.05-0.25."""
    spacing_m: Positive = 0.75
    """Distance from crest to crest, across [m]. Assumed value: row crops, 0.5-0.9."""
    furrow_direction_deg: float = 90.0
    """Direction in which the furrows run, from east, counter-clockwise [deg]. 90: a path to the east crosses them."""
    offset_m: float = 0.0
    """Distance of a crest from the origin, to the right of that direction [m]."""
    profile: Literal["sine", "flat"] = "sine"
    """Shape of the section: round, or with level crests and troughs like beds."""

    def finest(self) -> float:
        """Return the maximum distance between nodes: eight nodes per furrow [m]."""
        return self.spacing_m / 8

    def bare(self, x: Array, y: Array) -> Array:
        """Return the heights about the mean level."""
        direction = radians(self.furrow_direction_deg)
        right = sin(direction) * x[None, :] - cos(direction) * y[:, None]
        turns = (right - self.offset_m) / self.spacing_m
        d = np.abs(turns - np.round(turns))
        if self.profile == "flat":
            d = np.clip((d - LEVEL_SHARE / 2) / (1 - 2 * LEVEL_SHARE), 0.0, 0.5)
        return self.depth_m / 2 * np.cos(2 * np.pi * d)
