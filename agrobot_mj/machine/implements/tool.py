"""Tool of an implement in the soil: `[implement.tool]`."""

from math import degrees
from typing import Annotated

from pydantic import Field

from agrobot_mj.core.spec import NonNegative, Positive, Spec, Spread
from agrobot_mj.machine.implements.draught import TEXTURES, TOOLS, Texture, ToolLaw, ToolType


class Tool(Spec):
    """Size, depth and soil of a tool, and its grip to the side."""

    type: ToolType = "mouldboard_plough"
    """Row of the table of ASABE D497 that gives the draught."""
    size: Annotated[float, Field(gt=0, le=100)] = 0.25
    """Width of ploughs and harrows [m], tools of cultivators, rows of seeders [-]. Estimate: one bottom."""
    depth_m: Annotated[float, Field(ge=0.005, le=1)] = 0.12
    """Depth on level ground [m]. Estimate (0.1-0.2 for a compact tractor's plough)."""
    texture: Texture = "medium"
    """Texture of the soil, factor F_i of D497."""
    draught_scale: Annotated[float, Field(ge=0, le=10)] = 1.0
    """Draught of this field over that of D497, which holds within 25 to 50 % [-]."""
    noise_share: Spread = 0.15
    """Standard deviation of the draught over its mean, log-normal [-]. Estimate (0.1-0.3)."""
    noise_length_m: Annotated[float, Field(ge=0.01, le=100)] = 0.5
    """Correlation length of the draught along the way [m]. Estimate (0.2-2)."""
    cornering_stiffness_n_deg: NonNegative = 150.0
    """Lateral force per degree of slip angle at the intended depth [N/deg]. Estimate: 450-3400 published for
    implements of a tractor of 10 t (Pearson and Bevly, 2008), less by a compact tractor's width and depth."""
    relaxation_m: Annotated[float, Field(ge=0.02, le=10)] = 0.4
    """Way over which the lateral force builds up [m]. Estimate (0.2-1)."""
    side_limit_n: Positive = 2500.0
    """Lateral force at which the soil gives way [N]. Estimate: the soil beside a share of this depth."""
    suction_share: Annotated[float, Field(ge=0, le=2)] = 0.2
    """Downward force of the soil over the draught [-]. Estimate (0-0.3)."""

    def law(self) -> ToolLaw:
        """Coefficients in SI units, but for the speed."""
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
