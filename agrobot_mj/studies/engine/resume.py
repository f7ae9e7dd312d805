"""Rows of runs in a folder: a run that is there is read, another is done, and its row written before the next.

A row appears whole or not at all, so that a study that is broken off at any moment goes on with what is missing.
"""

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.scenario.overrides import files
from agrobot_mj.simulation.ownership import reserve
from agrobot_mj.simulation.storage import atomic, exclusive, sweep_up, write_json
from agrobot_mj.studies.engine.tasks import Done, Task, digest, origin
from agrobot_mj.studies.engine.workers import Perform, performing

ROWS = "rows"
RunTasks = Callable[[Sequence[Task]], list[Done]]
"""Function that does tasks, some at a time; results in the order of the tasks."""


Failed = Callable[[str], object]
"""Function that is called with the error of a run."""


class RowFiles:
    """Files below a folder of results; links are not followed."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def read(self, name: str) -> dict[str, Any] | None:
        """A row, by its path from `ROWS` without the ending; None where there is none that can be read."""
        try:
            row = json.loads((self.folder / ROWS / f"{name}.json").read_bytes())
        except (OSError, ValueError, RecursionError):
            return None  # torn by a loss of power, say: the run counts as missing
        return row if isinstance(row, dict) else None

    def write(self, name: str, row: Mapping[str, Any]) -> None:
        """Write a row."""
        write_json(self.place(Path(ROWS, f"{name}.json")), row)

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
    """Does tasks, each once: one that has a row of the same scenario, plugins, version and program is not repeated.

    A run that raised an error is tried again.
    """

    def __init__(self, folder: Path, perform: Perform, failed: Failed) -> None:
        self.files, self.perform, self.failed = RowFiles(folder), perform, failed
        self.origin, self.contents = origin(), cache(_contents)

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
        keys = [self._key(task) for task in tasks]
        names = names or [f"{key[:2]}/{key}" for key in keys]
        found, todo = dict[str, Done](), dict[str, Task]()
        for k, (name, key, task) in enumerate(zip(names, keys, tasks, strict=True)):
            row = self.files.read(name) or {}
            if row.pop("task", None) == key and row.get("error") is None:
                found[name] = Done(row, {})
                done(expected=row["expected"], there=True)
            elif name not in todo:
                todo[name] = task._replace(number=k)
        for task, result in self.perform(todo.values()):
            name = names[task.number]
            self.files.forget(name)  # since its files are about to change
            keep(task.number, result.files)
            self.files.write(name, {"task": keys[task.number], **result.numbers})
            found[name] = Done(result.numbers, {})
            done(expected=result.numbers["expected"], there=False)
            if error := result.numbers["error"]:
                self.failed(error)
        return [found[name] for name in names]

    def _key(self, task: Task) -> str:
        """16 hex digits of all that the numbers of a run depend on."""
        measure = getattr(task.measure, "__name__", repr(task.measure)) if task.measure else ""
        content = [task.base, task.overrides, task.keep, measure, self.contents(task.base), self.origin]
        content += [task.branches] if task.branches else []
        return digest(json.dumps(content, sort_keys=True, default=str).encode())


@contextmanager
def resuming(
    folder: Path, names: Sequence[str], jobs: int | None, failed: Failed = lambda text: None, most: int | None = None
) -> Iterator[Resumed]:
    """What does tasks, of which `folder` keeps the rows; within the block it is this process's alone.

    `names` are the files that a study writes there, `jobs` and `most` as of `performing`. Raises `ScenarioError`.
    """
    with exclusive(folder, (*names, ROWS)), performing(jobs, most=most) as perform:
        reserve(folder, [ROWS])
        for place in (folder / ROWS, *filter(Path.is_dir, (folder / ROWS).rglob("*"))):
            sweep_up(place, lambda name: name.endswith((".json", ".npy")))
        yield Resumed(folder, perform, failed)


def _contents(base: str) -> list[str]:
    """Digests of the data files that a base scenario names."""
    return [digest(path.read_bytes()) for path in files(json.loads(base))]
