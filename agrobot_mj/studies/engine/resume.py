"""Row files of runs in a folder: existing rows are read, missing runs are simulated and their rows written.

A row contains the results of a run. Its file is named after the request of the task, so that a study that is extended,
moved or interrupted continues with the missing runs. Rows contain the identity of their task: the request, the named
files, and the code (`core.identity`). A row of another identity, or of a run that raised, counts as missing.
"""

import json
import sys
from collections import Counter
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cache, partial
from pathlib import Path
from typing import Any, Protocol

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.core.identity import Identity, code, differing, digest, file_digest, joined
from agrobot_mj.core.interrupts import held_back
from agrobot_mj.core.version import __version__
from agrobot_mj.scenario.schema import Scenario
from agrobot_mj.simulation.results import atomic, results, write_json
from agrobot_mj.studies.engine.inputs import INPUTS, Held, InputCopies
from agrobot_mj.studies.engine.tasks import Row, Task
from agrobot_mj.studies.engine.workers import Perform, performing

ROWS = "rows"
FOLDERS = (f"{ROWS}/", f"{INPUTS}/")
NAME_DIGITS = 16
"""Number of digits of the request digest in the name of a row file."""
RunTasks = Callable[[Sequence[Task]], list[Row]]
"""Function that does tasks, some at a time; rows in the order of the tasks."""


class RunFiles(Protocol):
    """Files of runs stored by a study in addition to the rows."""

    def has(self, task: Task, row: Row) -> bool:
        """Return whether the files of a run exist."""

    def put(self, task: Task, contents: Mapping[str, bytes]) -> None:
        """Write the files of a run, by name."""


class RowFiles:
    """Rows and other files below a folder of results; links are not followed."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.again = Counter[str]()
        """Number of rows that count as missing, by reason."""
        self.inputs = InputCopies(folder, self.write_bytes)
        self._held = cache(self._held_base)

    def asked(self, task: Task) -> Task:
        """Return a task with the copies of its files and its identity."""
        (base, text), code_of_measure = self._held(task.base), _source(task.measure)
        held = {key: self.inputs.held({key.rpartition(".")[2]: value}) for key, value in task.overrides.items()}
        overrides = {key: list(each.said.values()) for key, each in held.items()}
        said = [base.said, [*overrides.items()], code_of_measure, task.branches]  # the order of overrides counts
        files = [*base.files, *(file for each in held.values() for file in each.files)]
        name = digest(json.dumps(said, sort_keys=True, default=str).encode(), digits=NAME_DIGITS)
        driven = {key: next(iter(each.driven.values())) for key, each in held.items()}
        return task._replace(base=text, overrides=driven, identity=Identity(name, joined(files), *code()))

    def _held_base(self, base: str) -> tuple[Held, str]:
        held = self.inputs.held(json.loads(base))
        return held, json.dumps(held.driven, sort_keys=True)

    def drive(
        self, numbers: Iterable[int], task_of: Callable[[int], Task], perform: Perform, files: RunFiles | None = None
    ) -> Generator[tuple[Task, Row, bool]]:
        """Return each of some tasks with its row, and whether that was there; those first, the others as they end."""
        todo = []  # numbers, since a million tasks would fill the memory
        for number in numbers:
            task = self.asked(task_of(number))
            if (row := self.row(task)) and row["error"] is None and (files is None or files.has(task, row)):
                yield task, row, True
            else:
                todo.append(number)
        self.tell_again()
        for task, (row, contents) in perform(self.asked(task_of(number)) for number in todo):
            with held_back():
                self.row_file(task).unlink(missing_ok=True)  # since its files are about to change
                if files:
                    files.put(task, contents)
                self.write_row(task, row)
            yield task, row, False

    def row(self, task: Task) -> Row | None:
        """Return the row of a task with the same identity, without the identity; None without a readable one."""
        try:
            row = json.loads(self.row_file(task).read_bytes())
        except (OSError, ValueError, RecursionError):
            return None  # torn by a loss of power, say
        sound = isinstance(row, dict) and isinstance(row.get("outcome"), str) and isinstance(row.get("expected"), bool)
        if not sound or "error" not in row:
            return None
        if apart := differing(row.pop("task", None), str(task.identity)):
            self.again[f"with other {' and '.join(apart)}" if any(apart) else "without identity"] += 1
            return None
        return dict(row)

    def write_row(self, task: Task, row: Row) -> None:
        """Write the row of a task."""
        write_json(self.row_file(task), {"task": str(task.identity), **row})

    def row_file(self, task: Task, ending: str = ".json") -> Path:
        """Return the file of the row of a task with an identity, or another name in the same folder."""
        name = task.identity.scenario if task.identity else ""
        return self.place(Path(ROWS, name[:2], f"{name}{ending}"))

    def tell_again(self) -> None:
        """Print the number of rows that are run again and the reasons, if any."""
        if self.again:
            why = ", ".join(f"{count:,} {what}" for what, count in self.again.most_common())
            print(f"{self.folder}: rows of another identity are run again: {why}", file=sys.stderr)
            self.again.clear()

    def write_bytes(self, name: Path, content: bytes) -> None:
        """Write a file of any content."""
        with atomic(self.place(name)) as temporary:
            temporary.write_bytes(content)

    def place(self, name: Path) -> Path:
        """Return the path of a file below the folder. Raises `ScenarioError` where a link leads out of it."""
        for place in name.parents[:-1]:
            if (self.folder / place).is_symlink():
                raise ScenarioError(f"{self.folder / place}: is a link, which is not followed; move it away")
        return self.folder / name


class Study:
    """Does tasks of which a folder keeps the rows, each once."""

    def __init__(self, folder: Path, perform: Perform) -> None:
        self.rows, self.perform, self._errors = RowFiles(folder), perform, set[str]()

    def __call__(
        self,
        tasks: Sequence[Task],
        done: Callable[..., object] = lambda expected, there: None,
        files: RunFiles | None = None,
    ) -> list[Row]:
        """Return the rows of tasks, in order: `outcome`, `expected`, `error`, metrics, and values measured by the task.

        Equal tasks run once. `done` is called for each with whether its run ended as `expected`, and whether its row
        was `there` already; `files` stores files of the runs. Errors of runs are printed once.
        """
        names = [self.rows.asked(task).identity for task in tasks]
        first, found = dict[Identity | None, int](), dict[Identity | None, Row]()
        for number, name in enumerate(names):
            first.setdefault(name, number)
        for task, row, there in self.rows.drive(first.values(), partial(_numbered, tasks), self.perform, files):
            found[task.identity] = row
            done(expected=row["expected"], there=there)
            if (error := row["error"]) and error not in self._errors:
                self._errors.add(error)
                print(f"a run raised an error: {error}", file=sys.stderr)
        return [found[name] for name in names]


@contextmanager
def study(folder: Path, names: Sequence[str], jobs: int | None = None) -> Iterator[Study]:
    """Yield a function that does tasks, of which `folder` keeps the rows; within the block it is this process's alone.

    `names` are the files that the study writes there, as of `results`; `jobs` is the number of processes, by default
    one per core. Raises `ScenarioError`.
    """
    with results(folder, (*names, *FOLDERS)), performing(jobs) as perform:
        yield Study(folder, perform)


def about(scenario: Scenario) -> dict[str, Any]:
    """Return the header of a study's answer: name and identity of its scenario, and the version."""
    return {"scenario": scenario.name, "version": __version__, "identity": str(scenario.identity)}


def _numbered(tasks: Sequence[Task], number: int) -> Task:
    return tasks[number]._replace(number=number)


def _source(measure: Callable[..., Any] | None) -> list[str]:
    """Return the name of a function or object that measures, and the digest of the file that it comes from."""
    if measure is None:
        return []
    file = getattr(sys.modules.get(measure.__module__), "__file__", None)
    return [getattr(measure, "__name__", repr(measure)), file_digest(Path(file)) if file else ""]
