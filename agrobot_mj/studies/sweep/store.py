"""The folder of a sweep.

`sweep.toml` and `base.toml` (resolved) with the data files that they name, `plan.json` (what the rows belong to), a
file for each run under `rows/`, what is kept of runs under `runs/`, and `sweep.parquet`, all rows as one table.
Every file appears whole or not at all, so that a sweep killed at any moment goes on with what is missing.
"""

import json
import os
import shutil
from collections import Counter
from collections.abc import Container, Iterable, Iterator, Mapping
from contextlib import suppress
from itertools import islice
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import tomli_w

from agrobot_mj.core.errors import ScenarioError, shortened
from agrobot_mj.core.identity import Identity, code, differing, digest
from agrobot_mj.scenario.overrides import explicit_values, files, flat
from agrobot_mj.scenario.plugins import plugin_note
from agrobot_mj.simulation.results import atomic, claim, is_bare, remove, write_json
from agrobot_mj.simulation.storage import RECORDING, SET
from agrobot_mj.studies.engine.inputs import INPUTS
from agrobot_mj.studies.engine.resume import ROWS, RowFiles
from agrobot_mj.studies.engine.tasks import Done, Task, files_kept
from agrobot_mj.studies.sweep.plan import RunPlan, SweepPlan
from agrobot_mj.studies.sweep.schema import portable, renamed

TABLE, PLAN, RUNS = "sweep.parquet", "plan.json", "runs"
FOLDERS = (f"{ROWS}/", f"{RUNS}/", f"{INPUTS}/")
CODE = ("plugins", "program", "libraries")
"""Parts of `digests` that say what code was run."""
DIGITS = 8
"""Digits of the number of a run in names."""
IN_A_FOLDER = 1000
"""Rows in a folder, since many file systems and tools are slow on larger ones."""
IN_A_PIECE = 2000
"""Rows that are in memory at a time while the table is written."""


def digests(plan: SweepPlan) -> dict[str, str]:
    """Digests of what the rows of a sweep depend on, by part; equal for equal files in another place."""
    content, base, named = portable(plan.sweep)
    of_base = files(explicit_values(plan.sweep.base))  # those are in its hash
    data = [named[name].read_bytes() for name in sorted(named) if named[name] not in of_base and named[name].is_file()]
    about = ("title", "version", "keep")
    return {
        "sweep": digest(json.dumps({k: v for k, v in content.items() if k not in about}, sort_keys=True).encode()),
        "base": f"{plan.sweep.base.hash8}-{digest(json.dumps(base, sort_keys=True).encode())}",
        "data files": digest(*data),
        **dict(zip(CODE, code(), strict=True)),
    }


class Store(RowFiles):
    """The results of a sweep in a folder."""

    @property
    def begun(self) -> dict[str, Any] | None:
        """What `plan.json` says of the rows in the folder; None where there is none.

        Raises `ScenarioError` where it is no plan of a sweep, or names files elsewhere.
        """
        try:
            content = json.loads((self.folder / PLAN).read_text("utf-8"))
        except FileNotFoundError:
            return None
        except (OSError, ValueError, RecursionError):
            raise ScenarioError(f"{self.folder / PLAN}: cannot be read; --fresh begins anew") from None
        if not _is_plan(content):
            raise ScenarioError(
                f"{self.folder / PLAN}: is no plan of a sweep; name another folder, or begin anew with --fresh"
            )
        return dict(content)

    def names(self, plan: SweepPlan) -> tuple[str, ...]:
        """Names of all that a sweep may write into its folder, see `results`."""
        return "base.toml", "sweep.toml", PLAN, TABLE, *FOLDERS, *plan.file_names.values()

    def begin(self, plan: SweepPlan) -> None:
        """Write what the rows to come belong to."""
        sweep, base, named = portable(plan.sweep)
        about = {"runs": plan.total, "name": plan.sweep.name, "of": digests(plan)}
        for name, path in named.items():
            if path != self.folder.resolve() / name:
                with atomic(self.folder / name) as temporary:
                    shutil.copyfile(path, temporary)
        for name, table in (("base.toml", base), ("sweep.toml", sweep)):
            with atomic(self.folder / name) as temporary:
                temporary.write_text(plugin_note() + tomli_w.dumps(table), encoding="utf-8")
        write_json(self.folder / PLAN, {**about, "text": sorted(plan.mixed), "files": sorted(named)})

    def clear(self, part: Container[int] | None = None) -> None:
        """Delete the results of a sweep, or of those of its runs that are in `part`; what else is there stays."""
        kept = self._kept_names()
        for number in self._numbers():
            if part is None or number in part:
                self._file(number).unlink(missing_ok=True)
        for number, place in self._kept():
            if part is None or number in part:
                for name in kept:
                    (place / name).unlink(missing_ok=True)
                _remove_if_empty(place)
        for place in (*map(Path, _entries(self.folder / ROWS)), self.folder / ROWS, self.folder / RUNS):
            _remove_if_empty(place)
        # The plan last: until then what is left still belongs to it.
        remove(self.folder, (TABLE,) if part is not None else (TABLE, PLAN))

    def changes(self, plan: SweepPlan) -> list[str]:
        """Parts of the input that have changed since the rows in the folder were written."""
        there = (self.begun or {}).get("of", {})
        return [part for part, digest in digests(plan).items() if there.get(part) != digest]

    def task(self, plan: SweepPlan, number: int) -> tuple[Task, Identity]:
        """What is to be run as number `number`."""
        return self.asked(Task(number, plan.base, plan.sweep.base.name, plan.run(number).overrides, plan.file.keep))

    def finished(self, plan: SweepPlan, number: int) -> bool:
        """Whether a run of the plan has its row, and what is to be kept of it."""
        if number >= plan.total or (row := self.there(_row_name(number), self.task(plan, number)[1])) is None:
            return False
        kept = files_kept(plan.file.keep, bool(row["expected"]))
        return all((self.folder / RUNS / f"{number:08}" / name).is_file() for name in kept)

    def stale(self, plan: SweepPlan) -> list[int]:
        """Numbers of rows that are not of this plan as it is run now."""
        return [number for number in sorted(self._numbers()) if not self.finished(plan, number)]

    def put(self, number: int, identity: Identity, row: Mapping[str, Any], kept: Mapping[str, bytes]) -> None:
        """Write what is kept of a run, then its row."""
        for name, content in kept.items():
            self.write_bytes(Path(RUNS, f"{number:08}", name), content)
        self.write(_row_name(number), row, identity)

    def row(self, run: RunPlan, done: Done, plan: SweepPlan) -> dict[str, Any]:
        """The row of a run, ready for JSON; data files by their names in the folder."""
        named = {key: renamed(key, value, plan.file_names) for key, value in run.parameters.items()}
        shown = {k: json.dumps(v) if k in plan.mixed else v for k, v in named.items()}
        variant = {} if run.variant is None else {"variant": run.variant}
        numbers = {key: value for key, value in flat(done.numbers) if key != "real_time_factor"}
        return {"run": run.number, **variant, "seed": run.seed, **shown, **numbers}

    def rows(self) -> Iterator[dict[str, Any]]:
        """Every row that can be read and is of the code that `plan.json` names, in the order of the runs."""
        of = (self.begun or {}).get("of", {})
        present = "-".join(str(of.get(part)) for part in CODE)
        for number in sorted(self._numbers()):
            row = self.read(_row_name(number))
            if row and row.get("run") == number and not differing(row.pop("task", None), present):
                yield row

    @property
    def count(self) -> int:
        """Number of rows that there are."""
        return sum(1 for _ in self.rows())

    @property
    def in_table(self) -> int:
        """Number of rows of the table; 0 where there is none."""
        try:
            return int(pq.read_metadata((self.folder / TABLE).absolute()).num_rows)
        except (OSError, ValueError, pa.ArrowException):
            return 0

    def write_table(self) -> int:
        """Write all rows as one table, in the order of the runs; returns how many there are.

        Raises `ScenarioError` where a row has a value of another type than the rest of its column.
        """
        rows, pieces = self.rows(), []
        try:
            while some := list(islice(rows, IN_A_PIECE)):
                pieces.append(_columns(some))
            if not pieces:
                return 0
            table = _in_order(pa.concat_tables(pieces, promote_options="permissive"))
        except UNFIT as error:
            if (odd := _odd_value(list(self.rows()))) is None:
                raise
            number, name, value = odd
            what = f"{name}: {shortened(repr(value))} is of another type than in the other rows"
            fix = "delete the file, also in the folder that it was merged from, and start the same command again"
            raise ScenarioError(f"{self._file(number)}: {what}; {fix}") from error
        with atomic(self.folder / TABLE) as temporary:
            pq.write_table(table, temporary, compression="zstd")
        return int(table.num_rows)

    def _file(self, number: int) -> Path:
        return self.folder / ROWS / f"{_row_name(number)}.json"

    def _kept(self) -> Iterator[tuple[int, Path]]:
        """Number and folder of each run of which something is kept."""
        for place in map(Path, _entries(self.folder / RUNS)):
            if place.name.isdecimal() and len(place.name) == DIGITS and place.is_dir() and not place.is_symlink():
                yield int(place.name), place

    def _kept_names(self) -> tuple[str, ...]:
        """Names of the files that are kept of a run."""
        try:
            files = (self.begun or {}).get("files", ())
        except ScenarioError:
            files = ()
        return *SET, RECORDING, *files

    def take(self, other: "Store", runs: int) -> None:
        """Copy the rows of another folder of the same sweep, and what is kept of their runs; no link is followed."""
        for number in other._numbers():
            if number < runs and _is_file(other._file(number)):
                self.write_bytes(Path(ROWS, f"{_row_name(number)}.json"), other._file(number).read_bytes())
        for number, place in other._kept():
            for name in other._kept_names():
                if number < runs and _is_file(place / name):
                    self.write_bytes(Path(RUNS, place.name, name), (place / name).read_bytes())

    def _numbers(self) -> Iterator[int]:
        for folder in _entries(self.folder / ROWS):
            for entry in _entries(Path(folder)):
                name = Path(entry).name.removesuffix(".json")
                if name.isdecimal():
                    yield int(name)


def read_rows(folder: Path) -> list[dict[str, Any]]:
    """Rows of the table in a sweep's folder. Raises OSError, ValueError or `pa.ArrowException` where there is none."""
    rows: list[dict[str, Any]] = pq.read_table((folder / TABLE).absolute()).to_pylist()
    return rows


def merge(sources: Iterable[Path], target: Store) -> dict[str, Any]:
    """Bring the rows of several folders of the same sweep together in `target`; returns their common plan.

    Raises `ScenarioError` where a folder is of no sweep, or of another.
    """
    stores = [Store(source) for source in sources]
    plans = {store.folder: store.begun for store in stores}
    for folder, plan in plans.items():
        if plan is None:
            raise ScenarioError(
                f"{folder}: has no results of a sweep ({PLAN}); name the folders that --shard has written"
            )
    common: dict[str, Any] = target.begun or plans[stores[0].folder] or {}
    for folder, plan in plans.items():
        different = [part for part, digest in common["of"].items() if (plan or {})["of"].get(part) != digest]
        if different:
            raise ScenarioError(
                f"{folder}: is of another sweep than the rest: different {', '.join(different)}; "
                "run it again there, or leave it out"
            )
    named = (*common.get("files", ()), "base.toml", "sweep.toml", PLAN)
    if target.begun is None and (lost := [name for name in named if not _is_file(stores[0].folder / name)]):
        raise ScenarioError(f"{stores[0].folder / lost[0]}: is missing from the results; run the sweep there again")
    claim(target.folder, (*named, TABLE, *FOLDERS))
    for store in stores:
        if store.folder.resolve() != target.folder.resolve():
            target.take(store, int(common["runs"]))
    if target.begun is None:
        for name in named:
            with atomic(target.folder / name) as temporary:
                shutil.copyfile(stores[0].folder / name, temporary)
    return common


def _is_plan(content: Any) -> bool:
    """Whether a `plan.json` says what a sweep's does, and names files of its own folder only."""
    if not isinstance(content, dict) or not isinstance(content.get("of"), dict):
        return False
    runs, files = content.get("runs"), content.get("files", [])
    return isinstance(runs, int) and runs > 0 and isinstance(files, list) and all(map(is_bare, files))


def _row_name(number: int) -> str:
    return f"{number // IN_A_FOLDER:05}/{number:0{DIGITS}}"


def _entries(folder: Path) -> list[str]:
    """Paths in a folder; none in a link to one."""
    return sorted(entry.path for entry in os.scandir(folder)) if folder.is_dir() and not folder.is_symlink() else []


def _is_file(path: Path) -> bool:
    return path.is_file() and not path.is_symlink()


def _remove_if_empty(folder: Path) -> None:
    if not folder.is_symlink():
        with suppress(OSError):
            folder.rmdir()


UNFIT = (pa.ArrowException, OverflowError, TypeError, ValueError)
"""Exceptions of pyarrow on values that make no column."""


def _odd_value(rows: list[dict[str, Any]]) -> tuple[int, str, Any] | None:
    """Run, column and value of the first value that makes no column together with most others of its name."""
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
    """The type of a value; whole numbers are numbers as well."""
    return float if type(value) is int else type(value)


def _columns(rows: list[dict[str, Any]]) -> pa.Table:
    """Some rows as a table; a number is a float unless all of its column are whole."""
    names = list(dict.fromkeys(name for row in rows for name in row))
    return pa.table({name: pa.array([row.get(name) for row in rows]) for name in names})


def _in_order(table: pa.Table) -> pa.Table:
    """The table with the wall time and the version last, and columns without any value as numbers."""
    end = [name for name in ("wall_s", "identity", "version") if name in table.column_names]
    table = table.select([name for name in table.column_names if name not in end] + end)
    empty = {"error": pa.string()}
    # Not by `Table.cast`: it fails on lists of records that have a field without any value.
    columns = {
        name: pa.nulls(len(table), empty.get(name, pa.float64())) if pa.types.is_null(column.type) else column
        for name, column in zip(table.column_names, table.columns, strict=True)
    }
    return pa.table(columns)
