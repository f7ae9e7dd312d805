"""The contract of a path: where the CG should be, and how fast it should go, at each time."""

from typing import Protocol

from agrobot_mj.core.signals import Reference
from agrobot_mj.paths.arc import Place


class PathLike(Protocol):
    """What every member of `Path` offers."""

    @property
    def speed_m_s(self) -> float:
        """Largest speed of the reference [m/s]."""
        ...

    @property
    def duration_s(self) -> float:
        """Time from rest to the end of the path [s]."""
        ...

    @property
    def turns_s(self) -> tuple[tuple[float, float], ...]:
        """(start, end) of each turn, over which metrics are taken [s]."""
        ...

    @property
    def max_curvature(self) -> float:
        """Largest absolute curvature [1/m]."""
        ...

    @property
    def sharpest(self) -> Place:
        """Where the curvature is largest."""
        ...

    def at(self, t: float) -> Reference:
        """The reference at time `t` [s]; waits before 0, goes on beyond the end."""
        ...
