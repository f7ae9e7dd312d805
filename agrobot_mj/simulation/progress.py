"""Progress on a terminal; nothing in a pipe."""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from agrobot_mj.plants.scene import Scene
from agrobot_mj.scenario.schema import Scenario
from agrobot_mj.simulation.log import Log, Rows

if TYPE_CHECKING:
    from rich.progress import Progress as Bar


def bar() -> "Bar | None":
    """A progress bar on stderr; None if that is not a terminal."""
    if not sys.stderr.isatty():
        return None
    # Imported here, since a run in a pipe does without.
    from rich.console import Console
    from rich.progress import BarColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn
    from rich.progress import Progress as Bar

    return Bar(
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        TextColumn("{task.percentage:3.0f} %"),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
        console=Console(stderr=True),
        transient=True,
    )


@contextmanager
def task(description: str, total: int, quiet: bool = False) -> Iterator[Callable[[], None]]:
    """Show a bar for `total` pieces of work; yields a function to call after each."""
    with tally(description, total, quiet=quiet) as advance:
        yield lambda: advance(True)


@contextmanager
def tally(description: str, total: int, done: int = 0, quiet: bool = False) -> Iterator[Callable[[bool], None]]:
    """Show a bar for runs, of which `done` are there already, with the number of those that failed.

    Yields a function to call after each run, with whether it ended as expected.
    """
    progress, failed = None if quiet else bar(), 0
    if progress is None:
        yield lambda expected: None
        return
    with progress:
        number = progress.add_task(description, total=total, completed=done)

        def advance(expected: bool) -> None:
            nonlocal failed
            failed += not expected
            text = f"{description}, {failed} failed" if failed else description
            progress.update(number, advance=1, description=text)

        yield advance


class Progress:
    """Shows the progress of one run."""

    def __init__(self) -> None:
        self.bar, self.rows = bar(), Rows(0, 0, 0)

    def start(self, scenario: Scenario, scene: Scene, rows: Rows) -> None:
        """Show an empty bar."""
        self.rows = rows
        if self.bar:
            self.bar.start()
            self.number = self.bar.add_task(scenario.name or "run", total=rows.ticks)

    def advance(self, first: int) -> None:
        """Move the bar."""
        if self.bar:
            self.bar.update(self.number, completed=self.rows.filled)

    def finish(self, log: Log) -> None:
        """Remove the bar."""
        if self.bar:
            self.bar.stop()

    def fail(self, error: BaseException) -> None:
        """Remove the bar."""
        if self.bar:
            self.bar.stop()
