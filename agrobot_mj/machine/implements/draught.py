"""Draught of tools in soil after ASABE D497: D = F_i (A + B S + C S^2) W T.

F_i stands for the texture of the soil, S is the speed [km/h], W the width [m] or the number of tools or rows, T the
depth [cm], 1 for seeding machines. The standard gives the mean over soils of a texture; fields lie within the range of
`Draught.spread` around it. The numbers of `TOOLS` are those of the standard's table of draught parameters as we
remember them: check them against your edition.
"""

from typing import Literal, NamedTuple

from agrobot_mj.core.kernels import kernel

ToolType = Literal[
    "mouldboard_plough", "chisel_plough", "disc_harrow", "field_cultivator", "row_crop_planter", "grain_drill"
]
"""Tools of `TOOLS`."""
Texture = Literal["fine", "medium", "coarse"]
TEXTURES = ("fine", "medium", "coarse")
"""Textures of the soil, in the order of F_1, F_2, F_3."""
DEEPEST = 2.0
"""Depth over the intended one beyond which the draught grows no further: the frame rides on the soil [-]. Estimate."""


class Draught(NamedTuple):
    """Row of the table of draught parameters."""

    a: float
    """A [N per unit of width, and per cm of depth for tillage]."""
    b: float
    """B [the same, per km/h]."""
    c: float
    """C [the same, per (km/h)^2]."""
    textures: tuple[float, float, float]
    """F_i in fine, medium and coarse soil [-]."""
    by_depth: bool
    """Whether the draught is proportional to the depth: tillage, not seeding."""
    spread: float
    """Range of fields around the formula, either way [-]."""


TOOLS: dict[str, Draught] = {
    "mouldboard_plough": Draught(652.0, 0.0, 5.1, (1.0, 0.70, 0.45), True, 0.40),
    "chisel_plough": Draught(91.0, 5.4, 0.0, (1.0, 0.85, 0.65), True, 0.50),
    "disc_harrow": Draught(309.0, 16.0, 0.0, (1.0, 0.88, 0.78), True, 0.50),
    "field_cultivator": Draught(32.0, 1.9, 0.0, (1.0, 0.85, 0.65), True, 0.25),
    "row_crop_planter": Draught(500.0, 0.0, 0.0, (1.0, 1.0, 1.0), False, 0.25),
    "grain_drill": Draught(400.0, 0.0, 0.0, (1.0, 1.0, 1.0), False, 0.25),
}
"""Width in metres for the mouldboard plough and the disc harrow (tandem, primary tillage); tools for the chisel plough
(straight points, primary tillage) and the field cultivator (secondary tillage); rows for the planter (mounted, seeding
only) and the drill (press wheels, below 2.4 m). Estimate: ASABE D497, from memory."""


class ToolLaw(NamedTuple):
    """Coefficients of one tool in its soil, as the compiled kernel takes them."""

    a: float
    """A, times F_i and W [N, per cm of depth for tillage]."""
    b: float
    """B, likewise [N h/km]."""
    c: float
    """C, likewise [N h2/km2]."""
    by_depth: float
    """1 where the draught is proportional to the depth, else 0."""
    depth: float
    """Intended depth [m]."""
    cornering: float
    """Lateral force over slip angle at the intended depth [N/rad]."""
    relaxation: float
    """Relaxation length of the lateral force [m]."""
    side_limit: float
    """Largest lateral force at the intended depth [N]."""
    suction: float
    """Downward force over draught [-]."""


@kernel
def engaged(law: ToolLaw, depth: float) -> float:
    """Depth over the intended one, as far as it counts [-]."""
    return min(max(depth / law.depth, 0.0), DEEPEST)


@kernel
def draught(law: ToolLaw, speed: float, depth: float) -> float:
    """Draught at a speed [m/s] and a depth [m], before its unevenness [N]."""
    S, share = 3.6 * abs(speed), engaged(law, depth)
    T = 100.0 * law.depth * share if law.by_depth > 0.5 else min(share, 1.0)
    return (law.a + law.b * S + law.c * S * S) * T
