"""Row files of runs in a results folder. Runs with an existing row are skipped; missing runs are simulated.

A row contains the results of a run. The file name is a digest of the task (scenario, overrides, measuring function), so
that an extended, moved or interrupted study continues with the missing runs. Each row contains the identity of its
task: digests of the task, input files and code (`core.identity`). Rows with another identity, and rows of runs that
raised an exception, count as missing.

The results folder also contains copies of scenario input files, which are read by the runs. Each copy is in a folder
named after a digest of its content and is never overwritten. Changes of the original files during a study have no
effect.
"""

import json
import sys
from collections import Counter
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from copy import deepcopy
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import tomli_w

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.core.identity import Identity, code, differing, digest, file_digest, joint_digest
from agrobot_mj.core.interrupts import held_back
from agrobot_mj.core.resources import library_file, machine_files
from agrobot_mj.core.version import __version__
from agrobot_mj.scenario.overrides import beside, machine_data, naming_files
from agrobot_mj.scenario.schema import Scenario
from agrobot_mj.simulation.results import atomic, results, write_json
from agrobot_mj.studies.engine.tasks import Row, Task
from agrobot_mj.studies.engine.workers import Perform, performing

INPUTS = "inputs"


class Held(NamedTuple):
    """Scenario data with copied input files, in two forms: for execution, and for the run identity."""

    driven: dict[str, Any]  # Scenario data with the paths of the copied files, used by the run
    said: dict[str, Any]  # Scenario data with file names instead of paths, used for the identity of the run
    files: tuple[str, ...]  # Digests of the input files


class InputCopies:
    """Copies of input files in a results folder. Each original file is read once."""

    def __init__(self, folder: Path, write: Callable[[Path, bytes], None]) -> None:
        self.folder, self.write = folder.absolute(), write
        self._copies: dict[tuple[str, Path], Path] = {}

    def with_copies(self, data: Mapping[str, Any]) -> Held:
        """Return scenario data with the paths of copied files. Paths of unreadable files are kept, so that the run
        fails."""
        driven, said, found = deepcopy(dict(data)), deepcopy(dict(data)), list[str]()
        for (table, key), (other, _) in zip(list(naming_files(driven)), list(naming_files(said)), strict=True):
            try:
                copy = self._copy(key, library_file(table[key]))
            except OSError:
                continue
            table[key], other[key] = str(copy), copy.name
            found.append(copy.parent.name)
        if shipped := machine_files().get(str(data["machine"])) if "machine" in data else None:
            found.append(file_digest(shipped))
        return Held(driven, said, tuple(found))

    def _copy(self, key: str, path: Path) -> Path:
        if (key, path) not in self._copies:
            contents = {path.name: self._content(key, path)}
            if key != "machine":  # the files of a machine are copied separately
                contents |= {other.name: other.read_bytes() for other in beside(key, path)}
            parts = (part for name in sorted(contents) for part in (name.encode(), contents[name]))
            place = Path(INPUTS, digest(*parts))
            for name, content in contents.items():
                file = self.folder / place / name
                if not file.is_file() or file.read_bytes() != content:
                    self.write(place / name, content)
            self._copies[key, path] = self.folder / place / path.name
        return self._copies[key, path]

    def _content(self, key: str, path: Path) -> bytes:
        """Return the content of an input file. In a machine file, file paths are replaced by the paths of the
        copies."""
        if key != "machine":
            return path.read_bytes()
        held = self.with_copies(machine_data(path))
        if not held.files:
            return path.read_bytes()
        for table, each in naming_files(held.driven):
            copy = Path(table[each])
            table[each] = f"../{copy.parent.name}/{copy.name}"
        return tomli_w.dumps(held.driven).encode()


ROWS = "rows"
FOLDERS = (f"{ROWS}/", f"{INPUTS}/")
NAME_DIGITS = 16  # Number of digits of the task digest in a file name
RunTasks = Callable[[Sequence[Task]], list[Row]]
"""Type of a function that executes tasks and returns their rows in the order of the tasks."""


class RowFiles:
    """Row files (one per run) and copies of input files in a results folder. Symbolic links are rejected."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.again = Counter[str]()
        """Number of outdated rows whose runs are repeated, by reason."""
        self.inputs = InputCopies(folder, self.write_bytes)
        self._held, self._code = cache(self._held_base), cache(_module_digest)

    def with_identity(self, task: Task) -> Task:
        """Return a task with its identity and with the paths of copied input files."""
        (base, text), measure, code_of_measure = self._held(task.base), task.measure, list[str]()
        if measure:
            code_of_measure = [getattr(measure, "__name__", repr(measure)), self._code(measure.__module__)]
        held = {key: self.inputs.with_copies({key.rpartition(".")[2]: value}) for key, value in task.overrides.items()}
        overrides = {key: list(each.said.values()) for key, each in held.items()}
        said = [base.said, [*overrides.items()], code_of_measure, task.branches]  # the order of overrides has an effect
        files = [*base.files, *(file for each in held.values() for file in each.files)]
        name = digest(json.dumps(said, sort_keys=True, default=str).encode(), digits=NAME_DIGITS)
        driven = {key: next(iter(each.driven.values())) for key, each in held.items()}
        return task._replace(base=text, overrides=driven, identity=Identity(name, joint_digest(files), *code()))

    def _held_base(self, base: str) -> tuple[Held, str]:
        held = self.inputs.with_copies(json.loads(base))
        return held, json.dumps(held.driven, sort_keys=True)

    def has(self, task: Task, row: Row) -> bool:
        """Return whether all files that belong to the row of a run exist. This class stores only rows."""
        return True

    def put(self, task: Task, contents: Mapping[str, bytes]) -> None:
        """Write the files of a run that belong to its row. `contents` maps file names to file contents."""

    def drive(
        self, numbers: Iterable[int], task_of: Callable[[int], Task], perform: Perform
    ) -> Generator[tuple[Task, Row, bool]]:
        """Execute the tasks without a stored row or with missing files, and the tasks whose run raised an exception.

        Yield each task, its row, and whether the row already existed. Existing rows are yielded first. Tasks from
        `task_of` have an identity.
        """
        todo = []  # a list of the tasks could exceed the memory
        for number in numbers:
            task = task_of(number)
            if (row := self.row(task)) and row["error"] is None and self.has(task, row):
                yield task, row, True
            else:
                todo.append(number)
        self.print_outdated()
        for task, (row, contents) in perform(map(task_of, todo)):
            with held_back():
                self.row_file(task).unlink(missing_ok=True)  # the files that belong to this row will be replaced
                self.put(task, contents)
                self.write_row(task, row)
            yield task, row, False

    def row(self, task: Task) -> Row | None:
        """Return the stored row of a task without its identity, or None if the row is missing, damaged or outdated."""
        try:
            row = json.loads(self.row_file(task).read_bytes())
        except (OSError, ValueError, RecursionError):
            return None  # for example, after a power failure
        sound = isinstance(row, dict) and isinstance(row.get("outcome"), str) and isinstance(row.get("expected"), bool)
        if not sound or "error" not in row:
            return None
        if apart := differing(row.pop("task", None), str(task.identity)):
            self.again[f"with other {' and '.join(apart)}" if any(apart) else "without identity"] += 1
            return None
        return dict(row)

    def write_row(self, task: Task, row: Row) -> None:
        """Write the row file of a task."""
        write_json(self.row_file(task), {"task": str(task.identity), **row})

    def row_file(self, task: Task, ending: str = ".json") -> Path:
        """Return the path of the row file of a task, or of a file with the same name and another extension `ending`."""
        name = task.identity.scenario if task.identity else ""
        return self.place(Path(ROWS, name[:2], f"{name}{ending}"))

    def print_outdated(self) -> None:
        """Print the number of outdated rows whose runs are repeated, with the reasons."""
        if self.again:
            why = ", ".join(f"{count:,} {what}" for what, count in self.again.most_common())
            print(f"{self.folder}: rows with another identity are run again: {why}", file=sys.stderr)
            self.again.clear()

    def write_bytes(self, name: Path, content: bytes) -> None:
        """Write a binary file in the results folder atomically."""
        with atomic(self.place(name)) as temporary:
            temporary.write_bytes(content)

    def place(self, name: Path) -> Path:
        """Return the path of a file in the results folder. Raise `ScenarioError` if a folder in the path is a link."""
        for place in name.parents[:-1]:
            if (self.folder / place).is_symlink():
                raise ScenarioError(f"{self.folder / place}: is a link, and links are not followed; remove the link")
        return self.folder / name


class Study:
    """Callable object that executes tasks and stores their rows in a results folder. Stored rows are reused."""

    def __init__(self, rows: RowFiles, perform: Perform) -> None:
        self.rows, self.perform, self._errors = rows, perform, set[str]()

    def __call__(self, tasks: Sequence[Task], done: Callable[..., object] = lambda expected, there: None) -> list[Row]:
        """Return the rows of the tasks in order: `outcome`, `expected`, `error`, metrics, and values measured by the
        task.

        Equal tasks are run once. `done` is called for each task with two flags: whether the run ended as expected, and
        whether the row existed. Equal error messages are printed once.
        """
        tasks = [self.rows.with_identity(task)._replace(number=number) for number, task in enumerate(tasks)]
        first, found = dict[Identity | None, int](), dict[Identity | None, Row]()
        for task in tasks:
            first.setdefault(task.identity, task.number)
        for task, row, there in self.rows.drive(first.values(), tasks.__getitem__, self.perform):
            found[task.identity] = row
            done(expected=row["expected"], there=there)
            if (error := row["error"]) and error not in self._errors:
                self._errors.add(error)
                print(f"a run raised an error: {error}", file=sys.stderr)
        return [found[task.identity] for task in tasks]


@contextmanager
def study(folder: Path, names: Sequence[str], jobs: int | None = None) -> Iterator[Study]:
    """Yield a function that executes tasks and stores their rows in `folder`, which stays locked within the context.

    `names` are the files that the study itself writes to the folder. `jobs` is the number of processes. Default: one
    per core. Raise `ScenarioError` if results must not be written to `folder`.
    """
    with results(folder, (*names, *FOLDERS)), performing(jobs) as perform:
        yield Study(RowFiles(folder), perform)


def about(scenario: Scenario) -> dict[str, Any]:
    """Return the header of study results: scenario name, scenario identity and package version."""
    return {"scenario": scenario.name, "version": __version__, "identity": str(scenario.identity)}


def _module_digest(name: str) -> str:
    """Return the digest of the source file of a loaded module, or "" without a file."""
    file = getattr(sys.modules.get(name), "__file__", None)
    return file_digest(Path(file)) if file else ""
