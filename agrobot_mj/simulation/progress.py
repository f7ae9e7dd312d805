"""Progress on a terminal; silence in a pipe."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.progress import Progress as Bar

from agrobot_mj.plants.scene import Scene
from agrobot_mj.scenario.schema import Scenario
from agrobot_mj.simulation.log import Log, Rows


def bar() -> Bar:
    """A progress bar on stderr, switched off when that is no terminal."""
    console = Console(stderr=True)
    return Bar(
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.percentage:3.0f} %"),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
        console=console,
        disable=not console.is_terminal,
        transient=True,
    )


@contextmanager
def task(description: str, total: int) -> Iterator[Callable[[], None]]:
    """A bar for `total` pieces of work; call what is given after each."""
    with bar() as progress:
        number = progress.add_task(description, total=total)
        yield lambda: progress.advance(number)


class Progress:
    """Watches one run."""

    def __init__(self) -> None:
        self.bar, self.rows = bar(), Rows(0, 0, 0)

    def start(self, scenario: Scenario, scene: Scene, rows: Rows) -> None:
        """Show an empty bar."""
        self.rows = rows
        self.bar.start()
        self.number = self.bar.add_task(scenario.name or "run", total=len(rows.values))

    def advance(self, first: int) -> None:
        """Move the bar."""
        self.bar.update(self.number, completed=self.rows.filled)

    def finish(self, log: Log) -> None:
        """Take the bar away."""
        self.bar.stop()

    def fail(self, error: BaseException) -> None:
        """Take the bar away."""
        self.bar.stop()
