"""Progress output on stderr: a bar on a terminal, otherwise lines."""

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from threading import Event, Thread
from typing import TYPE_CHECKING

from agrobot_mj.plants.scene import Scene
from agrobot_mj.scenario.schema import Scenario
from agrobot_mj.simulation.log import Log, Rows

if TYPE_CHECKING:
    from rich.progress import Progress as Bar

BETWEEN_LINES_S = 1.0  # Minimum time between two progress lines [s], so that fast work prints few lines
SILENCE_S = 6.0  # Maximum time without a progress line [s]
RUN_LINES = 5.0  # Time between two progress lines of a single run, divided by `SILENCE_S` [-]
LONGEST_IN_S, LONGEST_IN_MIN = 100.0, 100.0
"""Maximum durations that are printed in seconds [s] and in minutes [min]."""


def bar() -> "Bar | None":
    """Return a progress bar on stderr, or None if stderr is not a terminal."""
    if not sys.stderr.isatty():
        return None
    # imported here because runs in a pipe do not need it
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


class Count:
    """Progress output for a number of tasks: a bar on a terminal, otherwise lines with the remaining time."""

    def __init__(self, description: str, total: int, done: int, progress: "Bar | None", quiet: bool) -> None:
        self.description, self.total, self.done, self.bar, self.quiet = description, total, done, progress, quiet
        self.new, self.failed = 0, 0
        self.began = self.told = time.monotonic()
        if progress:
            self.number = progress.add_task(description, total=total, completed=done)

    def advance(self, count: int = 1, expected: bool = True, there: bool = False) -> None:
        """Count finished tasks: `expected` if they ended as expected, `there` if their results already existed."""
        self.done += count
        self.new += 0 if there else count
        self.failed += not expected
        failed = f", {self.failed} failed" if self.failed else ""
        if self.bar:
            self.bar.update(self.number, completed=self.done, description=f"{self.description}{failed}")
        elif not self.quiet and self._due():
            print(f"{self.description}: {self.done:,} done{failed}{self._time()}", file=sys.stderr, flush=True)

    @contextmanager
    def breaking_silence(self) -> Iterator[None]:
        """Within the context, print the elapsed time whenever no line was printed for `SILENCE_S`."""
        ended = Event()

        def print_time() -> None:
            while not ended.wait(max(SILENCE_S + self.told - time.monotonic(), 0.01)):
                if (now := time.monotonic()) - self.told >= SILENCE_S and (not self.total or self.done < self.total):
                    self.told = now
                    done = f"{self.done:,} done after " if self.total else ""
                    print(f"{self.description}: {done}{span(now - self.began)}", file=sys.stderr, flush=True)

        thread = Thread(target=print_time, daemon=True)
        thread.start()
        try:
            yield
        finally:
            ended.set()
            thread.join()

    def _due(self) -> bool:
        """Return whether to print a line: BETWEEN_LINES_S after the last line or, for the last task, after the start of
        the work."""
        now = time.monotonic()
        if now - (self.began if self.done >= self.total else self.told) < BETWEEN_LINES_S:
            return False
        self.told = now
        return True

    def _time(self) -> str:
        """Return the estimated remaining time or, after the last task, the total time as text."""
        spent = self.told - self.began
        if self.done >= self.total:
            return f", {span(spent)} in all"
        return f", {span(spent / self.new * (self.total - self.done))} left" if self.new else ""


@contextmanager
def tally(description: str, total: int, done: int = 0, quiet: bool = False) -> Iterator[Callable[..., None]]:
    """Display the number of finished tasks out of `total`, starting from `done`. Yield the function `Count.advance`."""
    progress = None if quiet else bar()
    count = Count(description, total, done, progress, quiet)
    with progress or (nullcontext() if quiet else count.breaking_silence()):
        yield count.advance


def print_elapsed(description: str, quiet: bool) -> AbstractContextManager[None]:
    """Return a context manager that prints the elapsed time on stderr every `SILENCE_S`, unless `quiet`."""
    return nullcontext() if quiet else Count(description, 0, 0, None, quiet).breaking_silence()


def span(seconds: float) -> str:
    """Return a duration as text, for example `48 s`, `12 min` or `3.5 h`."""
    if seconds < LONGEST_IN_S:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < LONGEST_IN_MIN * 60 else f"{seconds / 3600:.1f} h"


class Progress:
    """Progress output of one run: a bar on a terminal, otherwise lines.

    `began` is called after the first ticks, when all kernels are compiled.
    """

    def __init__(self, began: Callable[[], None] = lambda: None) -> None:
        self.bar, self.rows, self.began, self.name = bar(), Rows(0, 0, 0), began, ""
        self.told = time.monotonic()

    def start(self, scenario: Scenario, scene: Scene, rows: Rows) -> None:
        """Store the name of the run, and the log rows from which the progress follows. `advance` displays the bar."""
        self.rows, self.name, self.told = rows, scenario.name or "run", time.monotonic()

    def advance(self, first: int) -> None:
        """Display or update the progress bar, or print a line."""
        if first == 0:
            self.began()
        if not self.bar:
            if (now := time.monotonic()) - self.told >= RUN_LINES * SILENCE_S:
                self.told = now
                print(
                    f"{self.name}: {100 * self.rows.filled / self.rows.ticks:.0f} % simulated",
                    file=sys.stderr,
                    flush=True,
                )
            return
        if not self.bar.tasks:
            self.bar.start()
            self.number = self.bar.add_task(self.name, total=self.rows.ticks)
        self.bar.update(self.number, completed=self.rows.filled)

    def finish(self, log: Log) -> None:
        """Remove the bar after the run."""
        if self.bar:
            self.bar.stop()

    def fail(self, error: BaseException) -> None:
        """Remove the bar after an error."""
        if self.bar:
            self.bar.stop()
