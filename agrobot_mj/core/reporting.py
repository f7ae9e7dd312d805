"""Parts that have signals of their own for the log."""

from collections.abc import Sequence
from typing import Any, ClassVar

from agrobot_mj.core.signals import Column
from agrobot_mj.core.spec import Spec


class Reporting(Spec):
    """A part that adds columns to the log."""

    label: ClassVar[str]
    """Name in figures, of a class that has one of its own; else its kind."""

    @property
    def columns(self) -> tuple[Column, ...]:
        """Signals that it reports, besides those that every log has."""
        return ()

    def report(self, state: Any) -> Sequence[float]:
        """Values of `columns` that belong to the last output, from the state after it."""
        return ()
