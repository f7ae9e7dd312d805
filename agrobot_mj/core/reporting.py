"""Base class of sensors, guidance laws and other scenario components that add signals to the log."""

from collections.abc import Sequence
from typing import Any, ClassVar

from agrobot_mj.core.signals import Column
from agrobot_mj.core.spec import Spec


class Reporting(Spec):
    """Scenario component, such as a sensor or a guidance law, that adds columns to the log."""

    label: ClassVar[str]
    """Name of the component in figures; by default the `kind` of the component."""

    @property
    def columns(self) -> tuple[Column, ...]:
        """Columns that the component adds to the log."""
        return ()

    def report(self, state: Any) -> Sequence[float]:
        """Return the values of `columns` after the last tick; `state` is the state of the component after the same
        tick."""
        return ()
