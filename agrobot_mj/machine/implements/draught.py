"""Soil-engaging tools, and their draught from ASABE D497: D = F_i (A + B S + C S^2) W T.

F_i is the factor of the soil texture, S the speed [km/h], W the width [m] or the number of tools or rows. T is the
depth [cm], or 1 for seeding machines. The standard gives the mean over soils of a texture; the draught in a field
differs from this mean by up to `Draught.spread`. The numbers of `TOOLS` are quoted from memory: check them against your
edition of the standard.
"""

from math import degrees
from typing import Annotated, Literal, NamedTuple

from pydantic import Field

from agrobot_mj.core.kernels import kernel
from agrobot_mj.core.spec import NonNegative, Positive, Spec, Spread

ToolType = Literal[
    "mouldboard_plough", "chisel_plough", "disc_harrow", "field_cultivator", "row_crop_planter", "grain_drill"
]
"""Name of a tool in `TOOLS`."""
Texture = Literal["fine", "medium", "coarse"]
TEXTURES = ("fine", "medium", "coarse")  # Soil textures in the order of the factors F_1, F_2, F_3 of D497
DEEPEST = 2.0
"""Depth divided by intended depth [-] above which the draught is constant, because the frame slides. Assumed value."""


class Draught(NamedTuple):
    """Draught parameters of a tool: a row of the table in ASABE D497."""

    a: float  # Coefficient A of the speed-independent draught [N per unit of width, for tillage also per cm of depth]
    b: float  # Coefficient B of the draught proportional to the speed [unit of A per km/h]
    c: float  # Coefficient C of the draught proportional to the squared speed [unit of A per (km/h)^2]
    textures: tuple[float, float, float]  # Factors of the soil texture for fine, medium and coarse soil [-]
    by_depth: bool  # Whether the draught is proportional to the depth: True for tillage, False for seeding
    spread: float  # Maximum relative deviation of the draught in a field from the formula [-], in both directions


TOOLS: dict[str, Draught] = {
    "mouldboard_plough": Draught(652.0, 0.0, 5.1, (1.0, 0.70, 0.45), True, 0.40),
    "chisel_plough": Draught(91.0, 5.4, 0.0, (1.0, 0.85, 0.65), True, 0.50),
    "disc_harrow": Draught(309.0, 16.0, 0.0, (1.0, 0.88, 0.78), True, 0.50),
    "field_cultivator": Draught(32.0, 1.9, 0.0, (1.0, 0.85, 0.65), True, 0.25),
    "row_crop_planter": Draught(500.0, 0.0, 0.0, (1.0, 1.0, 1.0), False, 0.25),
    "grain_drill": Draught(400.0, 0.0, 0.0, (1.0, 1.0, 1.0), False, 0.25),
}
"""Draught parameters of each tool.

W is the width [m] of the plough and the tandem disc harrow (primary tillage), the number of tools of the chisel plough
(straight points, primary tillage) and the field cultivator (secondary tillage), or the number of rows of the planter
(mounted, seeding only) and the drill (press wheels, below 2.4 m). Assumed value: ASABE D497, from memory.
"""


class ToolLaw(NamedTuple):
    """Draught and lateral force coefficients of a tool in a given soil, for compiled functions such as `draught`."""

    a: float  # Speed-independent draught of the tool in its soil [N, per cm of depth for tillage]
    b: float  # Draught per speed of the tool in its soil [N h/km, per cm of depth for tillage]
    c: float  # Draught per squared speed of the tool in its soil [N h2/km2, per cm of depth for tillage]
    by_depth: float  # 1 if the draught is proportional to the depth, otherwise 0
    depth: float  # Intended depth of the tool [m]
    cornering: float  # Lateral force of the tool divided by its slip angle [N/rad], at the intended depth
    relaxation: float  # Relaxation length of the lateral force [m]
    side_limit: float  # Maximum lateral force of the tool at the intended depth [N]
    suction: float  # Downward force of the soil divided by the draught [-]


@kernel
def depth_ratio(law: ToolLaw, depth: float) -> float:
    """Return the depth `depth` [m] divided by the intended depth of the tool [-], limited to 0 to `DEEPEST`."""
    return min(max(depth / law.depth, 0.0), DEEPEST)


@kernel
def draught(law: ToolLaw, speed: float, depth: float) -> float:
    """Return the mean draught [N] of a tool at a speed [m/s] and depth [m]."""
    S, share = 3.6 * abs(speed), depth_ratio(law, depth)
    T = 100.0 * law.depth * share if law.by_depth > 0.5 else min(share, 1.0)
    return (law.a + law.b * S + law.c * S * S) * T


class Tool(Spec):
    """Tool of an implement (`[implement.tool]`): type, size, depth, soil and lateral force."""

    type: ToolType = "mouldboard_plough"
    """Tool type, which selects the draught parameters in ASABE D497."""
    size: Annotated[float, Field(gt=0, le=100)] = 0.25
    """Width of a plough or harrow [m], number of tools of a cultivator, or number of rows of a seeder [-]. Assumed
    value (range 0.2-0.35) for a plough with one bottom."""
    depth_m: Annotated[float, Field(ge=0.005, le=1)] = 0.12
    """Working depth on level ground [m]. Assumed value (range 0.1-0.2 for the plough of a compact tractor)."""
    texture: Texture = "medium"
    """Soil texture, which selects the factor F_i in ASABE D497."""
    draught_scale: Annotated[float, Field(ge=0, le=10)] = 1.0
    """Factor on the draught from ASABE D497 [-]. In a field, the draught differs from the formula by up to 25-50 %."""
    noise_share: Spread = 0.15
    """Standard deviation of the log-normal draught divided by the mean draught [-]. Assumed value (range 0.1-0.3)."""
    noise_length_m: Annotated[float, Field(ge=0.01, le=100)] = 0.5
    """Correlation length of the draught along the path [m]. Assumed value (range 0.2-2)."""
    cornering_stiffness_n_deg: NonNegative = 150.0
    """Lateral force per degree of slip angle at the intended depth [N/deg]. Assumed value: 450-3400 for implements of
    a 10 t tractor (Pearson and Bevly, 2008), scaled to a compact tractor by width and depth."""
    relaxation_m: Annotated[float, Field(ge=0.02, le=10)] = 0.4
    """Relaxation length of the lateral force [m]. Assumed value (range 0.2-1)."""
    side_limit_n: Positive = 2500.0
    """Maximum lateral force of the soil [N]. Assumed value (range 1000-5000 for soil next to a plough)."""
    suction_share: Annotated[float, Field(ge=0, le=2)] = 0.2
    """Downward force of the soil on the tool divided by the draught [-]. Assumed value (range 0-0.3)."""

    def law(self) -> ToolLaw:
        """Return the coefficients of the tool for the compiled function `draught`."""
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
