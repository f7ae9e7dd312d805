"""Rows of runs in a folder: a run that is there is read, another is done, and its row written before the next.

A row appears whole or not at all, so that a study that is broken off at any moment goes on with what is missing. Rows
carry the identity of their task: what was asked, the files that it names, and the code (`core.identity`). A row of
another identity, or of a run that raised, counts as missing.
"""

import json
import sys
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.core.identity import Identity, code, code_text, differing, digest, file_digest, joined
from agrobot_mj.core.interrupts import held_back
from agrobot_mj.simulation.results import atomic, results, write_json
from agrobot_mj.studies.engine.inputs import INPUTS, Held, InputCopies
from agrobot_mj.studies.engine.tasks import Done, Task
from agrobot_mj.studies.engine.workers import Perform, performing

ROWS = "rows"
NAME_DIGITS = 16
"""Digits of the digest of what a task asks, after which its row is named."""
RunTasks = Callable[[Sequence[Task]], list[Done]]
"""Function that does tasks, some at a time; results in the order of the tasks."""


Failed = Callable[[str], object]
"""Function that is called with the error of a run."""


class RowFiles:
    """Rows and other files below a folder of results; links are not followed."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.again = Counter[str]()
        """How many rows count as missing, by what their identity says."""
        self.inputs = InputCopies(folder, self.write_bytes)
        self._held: Callable[[str], Held] = cache(lambda base: self.inputs.held(json.loads(base)))

    def asked(self, task: Task) -> tuple[Task, Identity]:
        """A task that is driven from the copies of its files, and its identity."""
        base, code_of_measure = self._held(task.base), _source(task.measure)
        held = {key: self.inputs.held({key.rpartition(".")[2]: value}) for key, value in task.overrides.items()}
        overrides = {key: list(each.said.values()) for key, each in held.items()}
        said = [base.said, overrides, code_of_measure, task.branches]
        files = [*base.files, *(file for each in held.values() for file in each.files)]
        text = json.dumps(said, sort_keys=True, default=str).encode()
        driven = {key: next(iter(each.driven.values())) for key, each in held.items()}
        held_task = task._replace(base=json.dumps(base.driven, sort_keys=True), overrides=driven, code=code_text())
        return held_task, Identity(digest(text, digits=NAME_DIGITS), joined(files), *code())

    def there(self, name: str, identity: Identity) -> dict[str, Any] | None:
        """The row of a task with this identity; None where it is to be run."""
        if (row := self.read(name)) is None:
            return None
        if apart := differing(row.pop("task", None), str(identity)):
            self.again[f"with other {' and '.join(apart)}" if any(apart) else "without identity"] += 1
            return None
        return row if row.keys() >= {"outcome", "expected", "error"} and row["error"] is None else None

    def tell_again(self) -> None:
        """Say how many rows are run again and why, if there are any."""
        if self.again:
            why = ", ".join(f"{count:,} {what}" for what, count in self.again.most_common())
            print(f"{self.folder}: rows of another identity are run again: {why}", file=sys.stderr)
            self.again.clear()

    def read(self, name: str) -> dict[str, Any] | None:
        """A row, by its path from `ROWS` without the ending; None where there is none that can be read."""
        try:
            row = json.loads((self.folder / ROWS / f"{name}.json").read_bytes())
        except (OSError, ValueError, RecursionError):
            return None  # torn by a loss of power, say: the run counts as missing
        sound = isinstance(row, dict) and isinstance(row.get("outcome"), str) and isinstance(row.get("expected"), bool)
        return row if sound else None

    def write(self, name: str, row: Mapping[str, Any], identity: Identity) -> None:
        """Write the row of a task."""
        write_json(self.place(Path(ROWS, f"{name}.json")), {"task": str(identity), **row})

    def forget(self, name: str) -> None:
        """Delete a row."""
        self.place(Path(ROWS, f"{name}.json")).unlink(missing_ok=True)

    def write_bytes(self, name: Path, content: bytes) -> None:
        """Write a file of any content."""
        with atomic(self.place(name)) as temporary:
            temporary.write_bytes(content)

    def place(self, name: Path) -> Path:
        """The path of a file below the folder. Raises `ScenarioError` where a link leads out of it."""
        for place in name.parents[:-1]:
            if (self.folder / place).is_symlink():
                raise ScenarioError(f"{self.folder / place}: is a link, which is not followed; move it away")
        return self.folder / name


class Resumed:
    """Does tasks, each once: one whose row is there is not repeated."""

    def __init__(self, folder: Path, perform: Perform, failed: Failed) -> None:
        self.files, self.perform, self.failed = RowFiles(folder), perform, failed

    def __call__(
        self,
        tasks: Sequence[Task],
        names: Sequence[str] | None = None,
        keep: Callable[[int, Mapping[str, bytes]], object] = lambda k, files: None,
        done: Callable[..., object] = lambda expected, there: None,
    ) -> list[Done]:
        """The results of tasks, in their order, without their files: `keep` is given these, with the task's place.

        Rows have the `names` given, or such that equal tasks share one; `done` hears of each whether it ended as
        `expected`, and whether its row was `there` already.
        """
        asked = [self.files.asked(task) for task in tasks]
        names = names or [f"{identity.scenario[:2]}/{identity.scenario}" for _, identity in asked]
        found, todo = dict[str, Done](), dict[str, Task]()
        for k, (name, (task, identity)) in enumerate(zip(names, asked, strict=True)):
            if name in todo:
                continue
            if row := self.files.there(name, identity):
                found[name] = Done(row, {})
                done(expected=row["expected"], there=True)
            else:
                todo[name] = task._replace(number=k)
        for task, result in self.perform(todo.values()):
            name = names[task.number]
            with held_back():
                self.files.forget(name)  # since its files are about to change
                keep(task.number, result.files)
                self.files.write(name, result.numbers, asked[task.number][1])
            found[name] = Done(result.numbers, {})
            done(expected=result.numbers["expected"], there=False)
            if error := result.numbers["error"]:
                self.failed(error)
        return [found[name] for name in names]


@contextmanager
def resuming(
    folder: Path, names: Sequence[str], jobs: int | None, failed: Failed = lambda text: None, most: int | None = None
) -> Iterator[Resumed]:
    """What does tasks, of which `folder` keeps the rows; within the block it is this process's alone.

    `names` are those of `results`, `jobs` and `most` as of `performing`. Raises `ScenarioError`.
    """
    with results(folder, (*names, f"{ROWS}/", f"{INPUTS}/")), performing(jobs, most=most) as perform:
        resumed = Resumed(folder, perform, failed)
        try:
            yield resumed
        finally:
            resumed.files.tell_again()


def _source(measure: Callable[..., Any] | None) -> list[str]:
    """Name of a function or object that measures, and the digest of the file that it comes from."""
    if measure is None:
        return []
    file = getattr(sys.modules.get(measure.__module__), "__file__", None)
    return [getattr(measure, "__name__", repr(measure)), file_digest(Path(file)) if file else ""]
