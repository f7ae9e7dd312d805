"""Base of parts with additional log signals."""

from collections.abc import Sequence
from typing import Any, ClassVar

from agrobot_mj.core.signals import Column
from agrobot_mj.core.spec import Spec


class Reporting(Spec):
    """Part that adds columns to the log."""

    label: ClassVar[str]
    """Name in figures; by default the kind."""

    @property
    def columns(self) -> tuple[Column, ...]:
        """Reported signals, in addition to those of every log."""
        return ()

    def report(self, state: Any) -> Sequence[float]:
        """Return the values of `columns` for the last output, from the state after it."""
        return ()
