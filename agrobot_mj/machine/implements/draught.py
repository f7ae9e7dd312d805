"""Tools in soil, and their draught after ASABE D497: D = F_i (A + B S + C S^2) W T.

F_i stands for the texture of the soil, S is the speed [km/h], W the width [m] or the number of tools or rows, T the
depth [cm], 1 for seeding machines. The standard gives the mean over soils of a texture; fields lie within the range of
`Draught.spread` around it. The numbers of `TOOLS` are those of the standard's table of draught parameters as we
remember them: check them against your edition.
"""

from math import degrees
from typing import Annotated, Literal, NamedTuple

from pydantic import Field

from agrobot_mj.core.kernels import kernel
from agrobot_mj.core.spec import NonNegative, Positive, Spec, Spread

ToolType = Literal[
    "mouldboard_plough", "chisel_plough", "disc_harrow", "field_cultivator", "row_crop_planter", "grain_drill"
]
"""Tools of `TOOLS`."""
Texture = Literal["fine", "medium", "coarse"]
TEXTURES = ("fine", "medium", "coarse")
"""Textures of the soil, in the order of F_1, F_2, F_3."""
DEEPEST = 2.0
"""Depth divided by the intended depth above which the draught is constant, because the frame rides on the soil [-].
Assumed value."""


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
    """Range of fields around the formula, in both directions [-]."""


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
only) and the drill (press wheels, below 2.4 m). Assumed value: ASABE D497, from memory."""


class ToolLaw(NamedTuple):
    """Coefficients of one tool in its soil, as the compiled kernel takes them."""

    a: float
    """A, times F_i and W [N, per cm of depth for tillage]."""
    b: float
    """Coefficient B times F_i and W [N h/km, per cm of depth for tillage]."""
    c: float
    """Coefficient C times F_i and W [N h2/km2, per cm of depth for tillage]."""
    by_depth: float
    """1 where the draught is proportional to the depth, else 0."""
    depth: float
    """Intended depth [m]."""
    cornering: float
    """Lateral force divided by slip angle at the intended depth [N/rad]."""
    relaxation: float
    """Relaxation length of the lateral force [m]."""
    side_limit: float
    """Maximum lateral force at the intended depth [N]."""
    suction: float
    """Downward force divided by draught [-]."""


@kernel
def engaged(law: ToolLaw, depth: float) -> float:
    """Return the depth divided by the intended depth, limited to `DEEPEST` [-]."""
    return min(max(depth / law.depth, 0.0), DEEPEST)


@kernel
def draught(law: ToolLaw, speed: float, depth: float) -> float:
    """Return the draught at a speed [m/s] and a depth [m], before its unevenness [N]."""
    S, share = 3.6 * abs(speed), engaged(law, depth)
    T = 100.0 * law.depth * share if law.by_depth > 0.5 else min(share, 1.0)
    return (law.a + law.b * S + law.c * S * S) * T


class Tool(Spec):
    """Size, depth and soil of a tool, and its grip to the side; `[implement.tool]`."""

    type: ToolType = "mouldboard_plough"
    """Row of the table of ASABE D497 that gives the draught."""
    size: Annotated[float, Field(gt=0, le=100)] = 0.25
    """Width of ploughs and harrows [m], tools of cultivators, rows of seeders [-]. Assumed value (0.2-0.35): one
    bottom."""
    depth_m: Annotated[float, Field(ge=0.005, le=1)] = 0.12
    """Depth on level ground [m]. Assumed value (0.1-0.2 for a compact tractor's plough)."""
    texture: Texture = "medium"
    """Texture of the soil, factor F_i of D497."""
    draught_scale: Annotated[float, Field(ge=0, le=10)] = 1.0
    """Draught of this field divided by that of D497, which is accurate within 25 to 50 % [-]."""
    noise_share: Spread = 0.15
    """Standard deviation of the draught divided by its mean, log-normal [-]. Assumed value (0.1-0.3)."""
    noise_length_m: Annotated[float, Field(ge=0.01, le=100)] = 0.5
    """Correlation length of the draught along the path [m]. Assumed value (0.2-2)."""
    cornering_stiffness_n_deg: NonNegative = 150.0
    """Lateral force per degree of slip angle at the intended depth [N/deg]. Assumed value: 450-3400 published for
    implements of a tractor of 10 t (Pearson and Bevly, 2008), less by a compact tractor's width and depth."""
    relaxation_m: Annotated[float, Field(ge=0.02, le=10)] = 0.4
    """Relaxation length of the lateral force [m]. Assumed value (0.2-1)."""
    side_limit_n: Positive = 2500.0
    """Lateral force at which the soil yields [N]. Assumed value (1000-5000): soil next to a share."""
    suction_share: Annotated[float, Field(ge=0, le=2)] = 0.2
    """Downward force of the soil divided by the draught [-]. Assumed value (0-0.3)."""

    def law(self) -> ToolLaw:
        """Return the coefficients in SI units, but for the speed."""
        row = TOOLS[self.type]
        scale = self.draught_scale * self.size * row.textures[TEXTURES.index(self.texture)]
        return ToolLaw(
            a=scale * row.a,
            b=scale * row.b,
            c=scale * row.c,
            by_depth=float(row.by_depth),
            depth=self.depth_m,
            cornering=degrees(self.cornering_stiffness_n_deg),
            relaxation=self.relaxation_m,
            side_limit=self.side_limit_n,
            suction=self.suction_share,
        )
