"""Base class of the parts of a scenario that add signals to the log."""

from collections.abc import Sequence
from typing import Any, ClassVar

from agrobot_mj.core.signals import Column
from agrobot_mj.core.spec import Spec


class Reporting(Spec):
    """Part of a scenario, such as a sensor or a guidance law, that adds columns to the log."""

    label: ClassVar[str]
    """Name of the part in figures. Default: its kind."""

    @property
    def columns(self) -> tuple[Column, ...]:
        """Columns that the part adds to the log."""
        return ()

    def report(self, state: Any) -> Sequence[float]:
        """Return the values of `columns` after the last tick; `state` is the state of the part after the same tick."""
        return ()
