"""Results folder of a sweep.

The folder contains the resolved files `sweep.toml` and `base.toml`, data files, and `plan.json` with digests of all
inputs. The results are one file per row in `rows/`, files of runs in `runs/`, and `sweep.parquet`, the table of all
rows. All files are written atomically, so that an interrupted sweep can continue with the missing runs.
"""

import json
import os
import re
import shutil
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from itertools import islice
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import tomli_w

from agrobot_mj.core.errors import ScenarioError, shorten
from agrobot_mj.core.identity import code, digest
from agrobot_mj.scenario.overrides import explicit_values, files
from agrobot_mj.scenario.plugins import plugin_note, with_plugin_options
from agrobot_mj.simulation.results import MARK, atomic, claim, is_bare, owned_files, remove, results, write_json
from agrobot_mj.simulation.storage import RECORDING, SET
from agrobot_mj.studies.engine.resume import FOLDERS, ROWS, RowFiles
from agrobot_mj.studies.engine.tasks import LAST, POSES, Row, Task, files_kept
from agrobot_mj.studies.sweep.plan import RUNS, SweepPlan
from agrobot_mj.studies.sweep.schema import portable, read_sweep, rename_files

TABLE, PLAN = "sweep.parquet", "plan.json"
FILES = ("base.toml", "sweep.toml", PLAN)  # Names of the files that define a sweep, in addition to its data files
CODE = ("plugins", "program", "libraries")  # Keys in the result of `digests` that identify the code
_ROW = re.compile(r"[0-9a-f]+\.json")
"""Pattern of row file names, including row files of earlier versions."""
IN_A_PIECE = 2000  # Number of rows that are in memory at the same time while the table is written


def digests(plan: SweepPlan) -> dict[str, str]:
    """Return digests of all inputs that affect the rows of a sweep, by type of input. File locations have no effect."""
    content, base, named = portable(plan.sweep)
    of_base = files(explicit_values(plan.sweep.base))  # the digest of the base scenario includes these files
    data = [named[name].read_bytes() for name in sorted(named) if named[name] not in of_base and named[name].is_file()]
    about = ("title", "version", "keep")
    return {
        "sweep": digest(json.dumps({k: v for k, v in content.items() if k not in about}, sort_keys=True).encode()),
        "base": f"{plan.sweep.base.hash8}-{digest(json.dumps(base, sort_keys=True).encode())}",
        "data files": digest(*data),
        **dict(zip(CODE, code(), strict=True)),
    }


def read_plan(folder: Path) -> dict[str, Any] | None:
    """Return the content of `plan.json` in a results folder, or None if the file does not exist."""
    try:
        content = json.loads((folder / PLAN).read_text("utf-8"))
    except FileNotFoundError:
        return None
    except (OSError, ValueError, RecursionError):
        raise ScenarioError(f"{folder / PLAN}: cannot be read; start again with --fresh") from None
    if not _is_plan(content):
        raise ScenarioError(f"{folder / PLAN}: is not a sweep plan; specify another folder, or use --fresh")
    return dict(content)


class Store(RowFiles):
    """Results folder of a sweep with rows and kept files of runs. The plan determines the folders of the runs."""

    def __init__(self, folder: Path, plan: SweepPlan) -> None:
        super().__init__(folder)
        self.plan = plan

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all files and folders of a sweep, in the form required by `simulation.results.results`."""
        return *FILES, TABLE, *FOLDERS, *self.plan.names, *self.plan.file_names.values()

    @property
    def changed(self) -> bool:
        """Whether the results folder belongs to another plan, or to no plan."""
        there = (read_plan(self.folder) or {}).get("of", {})
        return any(there.get(part) != digest for part, digest in digests(self.plan).items())

    def begin(self) -> None:
        """Write the files that define the sweep."""
        sweep, base, named = portable(self.plan.sweep)
        for name, path in named.items():
            if path != self.folder.resolve() / name:
                self.write_bytes(Path(name), path.read_bytes())
        for name, table in (("base.toml", base), ("sweep.toml", sweep)):
            self.write_bytes(Path(name), (plugin_note() + tomli_w.dumps(table)).encode())
        about = {"runs": self.plan.total, "name": self.plan.sweep.name, "of": digests(self.plan)}
        if self.changed:
            remove(self.folder, (TABLE,))
        write_json(self.folder / PLAN, {**about, "files": sorted(named)})

    def clear(self, part: Iterable[int] | None = None) -> None:
        """Delete the results of all runs, or of the runs in the given `part` of the sweep. Files that are not results
        are kept."""
        if part is None:
            found = (Path(file) for folder in _entries(self.folder / ROWS) for file in _entries(Path(folder)))
            rows = [file for file in found if _ROW.fullmatch(file.name)]
            places = list(map(Path, _entries(self.folder / RUNS)))
        else:
            rows = [self.row_file(self.task(number)) for number in part]
            places = [self.folder / self.plan.folder(number) for number in part]
        for row in rows:
            row.unlink(missing_ok=True)
        for place in places:
            remove(place, (*SET, RECORDING, *self.plan.file_names.values()))
            _remove_if_empty(place)
        for place in (*map(Path, _entries(self.folder / ROWS)), self.folder / ROWS, self.folder / RUNS):
            _remove_if_empty(place)
        # The plan is deleted last, so that remaining files still belong to it.
        remove(self.folder, (TABLE,) if part is not None else (TABLE, PLAN))

    def task(self, number: int) -> Task:
        """Return the task of a run with its identity, as `with_identity` does."""
        return self.with_identity(self.plan.task(number))

    def has(self, task: Task, row: Row) -> bool:
        """Return whether all files to be kept for a run exist."""
        if not (names := files_kept(task.keep, bool(row["expected"]))):
            return True
        try:
            driven = json.loads(self.file(task, LAST).read_bytes())["identity"]
        except (OSError, ValueError, LookupError, TypeError):
            return False
        return bool(driven == row["identity"]) and all(self.file(task, name).is_file() for name in names)

    def put(self, task: Task, contents: Mapping[str, bytes]) -> None:
        """Replace the stored files of a run, and delete the results table, which is then outdated."""
        remove(self.folder, (TABLE,))
        place = self.file(task, LAST).parent
        if not contents and not place.exists():
            return
        if place.is_dir() and place.parent.name == RUNS and owned_files(place) is None:
            (place / MARK).touch()  # earlier versions did not mark the folders of runs
        with results(place, contents.keys() - {POSES}):
            remove(place, (*SET, RECORDING))
            for name, content in contents.items():
                with atomic(self.file(task, name)) as temporary:
                    temporary.write_bytes(content)

    def file(self, task: Task, name: str) -> Path:
        """Return the path of a kept file of a run. Poses are stored next to the row file."""
        return self.row_file(task, ".npy") if name == POSES else self.place(Path(self.plan.folder(task.number), name))

    def rows(self) -> Iterator[tuple[int, Row]]:
        """Yield the number and row of each completed run, in plan order."""
        for number in range(self.plan.total):
            if row := self.row(self.task(number)):
                yield number, row

    @property
    def in_table(self) -> int:
        """Number of rows in the results table, or 0 if there is no table."""
        try:
            return int(pq.read_metadata((self.folder / TABLE).absolute()).num_rows)
        except (OSError, ValueError, pa.ArrowException):
            return 0

    def line(self, number: int, row: Row) -> dict[str, Any]:
        """Return a row of the results table: run number, variant, seed, parameters, and results."""
        run, plan = self.plan.run(number), self.plan
        named = {key: rename_files(key, value, plan.file_names) for key, value in run.parameters.items()}
        shown = {key: json.dumps(value) if key in plan.mixed else value for key, value in named.items()}
        variant = {} if run.variant is None else {"variant": run.variant}
        numbers = {key: value for key, value in row.items() if key != "real_time_factor"}
        return {"run": number, **variant, "seed": run.seed, **shown, **numbers}

    def write_table(self) -> int:
        """Write the results table with all rows in run order. Return the number of rows."""
        rows, pieces = (self.line(*each) for each in self.rows()), []
        try:
            while some := list(islice(rows, IN_A_PIECE)):
                pieces.append(_columns(some))
            if not pieces:
                return 0
            table = _in_order(pa.concat_tables(pieces, promote_options="permissive"))
        except UNFIT as error:
            if (odd := _odd_value([self.line(*each) for each in self.rows()])) is None:
                raise
            number, name, value = odd
            what = f"{name}: {shorten(repr(value))} has a different type than in the other rows"
            fix = "delete the file, also in the folder that it was merged from, and run the same command again"
            file = self.row_file(self.task(number))
            raise ScenarioError(f"{file}: {what}; {fix}") from error
        with atomic(self.folder / TABLE) as temporary:
            pq.write_table(table, temporary, compression="zstd")
        return int(table.num_rows)

    def take(self, other: Path) -> None:
        """Copy rows and stored files of runs from another results folder of the same sweep. Links are not followed."""
        for number in range(self.plan.total):
            task = self.task(number)
            there = RowFiles(other).row_file(task)
            if not _is_file(there):
                continue
            self.write_bytes(there.relative_to(other), there.read_bytes())
            kept = map(Path, _entries(other / self.plan.folder(number)))
            if contents := {file.name: file.read_bytes() for file in kept if file.name != MARK and _is_file(file)}:
                self.put(task, contents)


def read_rows(folder: Path) -> list[dict[str, Any]]:
    """Return the rows of a sweep's results table. Raises OSError, ValueError or `pa.ArrowException` for an unreadable
    table."""
    rows: list[dict[str, Any]] = pq.read_table((folder / TABLE).absolute()).to_pylist()
    return rows


def merge(sources: Sequence[Path], folder: Path) -> tuple[int, int]:
    """Merge the rows of several results folders of a sweep. Return the numbers of rows and of planned runs."""
    target = read_plan(folder)
    named = (*_common(sources, target).get("files", ()), *FILES)
    if target is None and (lost := [name for name in named if not _is_file(sources[0] / name)]):
        raise ScenarioError(f"{sources[0] / lost[0]}: is missing; run the sweep again in this folder")
    _plan_in(sources[0] if target is None else folder)
    claim(folder, (*named, TABLE, *FOLDERS, f"{RUNS}/"))
    for name in named if target is None else ():
        with atomic(folder / name) as temporary:
            shutil.copyfile(sources[0] / name, temporary)
    store = Store(folder, _plan_in(folder))
    for source in sources:
        if source.resolve() != folder.resolve():
            store.take(source)
    return store.write_table(), store.plan.total


def _plan_in(folder: Path) -> SweepPlan:
    try:
        return SweepPlan(read_sweep(folder / "sweep.toml"))
    except ScenarioError as error:
        raise with_plugin_options(error, folder / "sweep.toml") from None


def _common(sources: Sequence[Path], target: dict[str, Any] | None) -> dict[str, Any]:
    plans = {source: read_plan(source) for source in sources}
    for source, plan in plans.items():
        if plan is None:
            raise ScenarioError(
                f"{source}: the folder has no sweep results ({PLAN} is missing); specify folders written with --shard"
            )
    common: dict[str, Any] = target or plans[sources[0]] or {}
    for source, plan in plans.items():
        different = [part for part, digest in common["of"].items() if (plan or {})["of"].get(part) != digest]
        if different:
            raise ScenarioError(
                f"{source}: the folder belongs to another sweep: different {', '.join(different)}; "
                "run the same sweep in all folders, or omit this folder"
            )
    return common


def _is_plan(content: Any) -> bool:
    if not isinstance(content, dict) or not isinstance(content.get("of"), dict):
        return False
    runs, files = content.get("runs"), content.get("files", [])
    return isinstance(runs, int) and runs > 0 and isinstance(files, list) and all(map(is_bare, files))


def _entries(folder: Path) -> list[str]:
    return sorted(entry.path for entry in os.scandir(folder)) if folder.is_dir() and not folder.is_symlink() else []


def _is_file(path: Path) -> bool:
    return path.is_file() and not path.is_symlink()


def _remove_if_empty(folder: Path) -> None:
    """Remove a folder that is empty or contains only its marker file. A link is kept."""
    if not folder.is_symlink():
        with suppress(OSError):
            if [path.name for path in folder.iterdir()] == [MARK]:
                (folder / MARK).unlink()
            folder.rmdir()


UNFIT = (pa.ArrowException, OverflowError, TypeError, ValueError)
"""Exceptions of pyarrow for values that do not fit the type of a column."""


def _odd_value(rows: list[dict[str, Any]]) -> tuple[int, str, Any] | None:
    """Return the run number, column and value of the first value that does not fit the type of its column. Return None
    if all values fit."""
    for name in dict.fromkeys(name for row in rows for name in row):
        values = [(row["run"], row[name]) for row in rows if row.get(name) is not None]
        kinds = Counter(_kind(value) for _, value in values)
        ordinary = next((value for _, value in values if _kind(value) == kinds.most_common(1)[0][0]), None)
        for run, value in values:
            try:
                pa.array([ordinary, value])
            except UNFIT:
                return run, name, value
    return None


def _kind(value: Any) -> type:
    return float if type(value) is int else type(value)


def _columns(rows: list[dict[str, Any]]) -> pa.Table:
    names = list(dict.fromkeys(name for row in rows for name in row))
    return pa.table({name: pa.array([row.get(name) for row in rows]) for name in names})


def _in_order(table: pa.Table) -> pa.Table:
    end = [name for name in ("wall_s", "identity", "version") if name in table.column_names]
    table = table.select([name for name in table.column_names if name not in end] + end)
    empty = {"error": pa.string()}
    # `Table.cast` fails for lists of records with an empty field.
    columns = {
        name: pa.nulls(len(table), empty.get(name, pa.float64())) if pa.types.is_null(column.type) else column
        for name, column in zip(table.column_names, table.columns, strict=True)
    }
    return pa.table(columns)
