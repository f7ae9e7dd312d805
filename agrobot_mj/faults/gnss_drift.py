"""Positions that drift away evenly: a convergence that fails, corrections of an old epoch, interference."""

from typing import Annotated, Literal

from pydantic import Field

from agrobot_mj.core.signals import Conditions
from agrobot_mj.faults.base import Scripted

Metres = Annotated[float, Field(ge=-1e4, le=1e4)]
Rate = Annotated[float, Field(ge=-10, le=10)]


class GnssDrift(Scripted):
    """An offset of the position that grows; quality and velocity (Doppler) are those of a sound solution."""

    kind: Literal["gnss_drift"] = "gnss_drift"
    east_m_s: Rate = 0.0
    """Rate east [m/s]."""
    north_m_s: Rate = 0.1
    """Rate north [m/s]. Estimate (0.02-0.5)."""

    def apply(self, state: None, conditions: Conditions, t: float, dt: float) -> tuple[None, Conditions]:
        """Shift the position by what has grown at the end of the tick."""
        time = t + dt - self.start_s
        return None, shifted(conditions, self.east_m_s * time, self.north_m_s * time)


def shifted(conditions: Conditions, east: float, north: float) -> Conditions:
    """Conditions with the position farther east and north [m]."""
    x, y = conditions.gnss_offset
    return conditions._replace(gnss_offset=(x + east, y + north))
