"""Sweeps for the measured pages, and page blocks computed from their results. Only missing runs are simulated.

Each sweep has a folder in `runs/pages`, shared by all pages. The same command continues an interrupted sweep.
"""

import argparse
import json
import sys
import tomllib
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import tomli_w
from blocks import DOCS, page, put
from provenance import ROOT, statement

from agrobot_mj import load_scenario
from agrobot_mj.core.identity import PROGRAM, code_text
from agrobot_mj.core.resources import sweep_files
from agrobot_mj.simulation.progress import tally
from agrobot_mj.simulation.results import write_json
from agrobot_mj.studies.engine.workers import pool_map
from agrobot_mj.studies.sweep.runner import SweepOptions, sweep
from agrobot_mj.studies.sweep.store import TABLE, read_rows

Row = dict[str, Any]
Blocks = dict[str, str]  # Content of blocks by name of the block; empty if runs are missing


def shipped(name: str) -> dict[str, Any]:
    return tomllib.loads(sweep_files()[name].read_text("utf-8"))


def variants(name: str) -> dict[str, dict[str, Any]]:
    return {each["name"]: each["set"] for each in shipped(name)["variant"]}


class Study:
    """Study of a Makefile target, with its pages, its runs, and the command-line options."""

    def __init__(self, verb: str, pages: Sequence[str], parts: Sequence[str], doc: str | None, arguments: list[str]):
        """Create the study of the Makefile target `verb` for the named pages. `parts` contains the names of its parts,
        and `doc` is the help text."""
        parser = argparse.ArgumentParser(description=doc, formatter_class=argparse.RawDescriptionHelpFormatter)
        parser.add_argument("part", nargs="*", help=f"{', '.join(parts)}; default: all")
        parser.add_argument("--jobs", type=int, default=1, help="processes")
        parser.add_argument("--only-draw", action="store_true", help="write pages and figures without new runs")
        parser.add_argument("--seeds", type=int, help="number of seeds of each sweep and of tasks, for a trial")
        parser.add_argument("--variant", action="append", help="run only this variant of each sweep, for a trial")
        parser.add_argument("--set", type=_pair, action="append", default=[], help="KEY=VALUE of all runs, a trial")
        parser.add_argument("--runs", type=Path, default=ROOT / "runs" / "pages", help="folder of the runs")
        parser.add_argument("--docs", type=Path, default=DOCS, help="folder of the pages")
        given = parser.parse_args(arguments)
        if unknown := set(given.part) - set(parts):
            parser.error(f"{', '.join(sorted(unknown))}: unknown part (known: {', '.join(parts)})")
        self.parts, self.jobs, self.seeds, self.trial = given.part or parts, given.jobs, given.seeds, dict(given.set)
        self.only_draw, self.variants = given.only_draw, given.variant
        self.verb, self.pages = verb, [page(name, given.docs) for name in pages]
        self.images, self.runs = given.docs / "images", given.runs

    def rows(self, name: str, source: str | None = None, **changes: Any) -> list[Row]:
        """Return the rows of the sweep `source` (default: `name`) after simulating missing runs.

        `changes` replaces keys of the sweep file. The list is empty if runs are missing and must not be simulated. If
        rows were computed with other code, the program ends.
        """
        folder = self.runs / name
        if not self.only_draw:
            found = sweep(self._file(name, source or name, changes), folder, SweepOptions(jobs=self.jobs))
            print(f"{name}: {found.total} runs, {found.errors} with an error", file=sys.stderr)
        plan = folder / "plan.json"
        content = json.loads(plan.read_text("utf-8")) if (folder / TABLE).exists() else None
        if content is None or len(rows := read_rows(folder)) < content["runs"]:
            return []
        if content["of"]["program"] != PROGRAM:
            raise SystemExit(f"{folder}: the results come from another code version; remove the folder and run again")
        return rows

    def done(self, name: str, perform: Callable[[Any], Row], jobs: Sequence[Any]) -> list[Row]:
        """Return the result of `perform` for each job after computing missing results.

        Each result is stored in a file, in a folder named after the source hash. The list is empty if results are
        missing and must not be computed.
        """
        folder = self.runs / name / code_text()
        files = {folder / f"{sha256(repr(job).encode()).hexdigest()[:16]}.json": job for job in jobs[: self.seeds]}
        if not self.only_draw:
            folder.mkdir(parents=True, exist_ok=True)
            todo = [file for file in files if not file.exists()]
            with tally(f"{name}: {len(todo)} tasks", len(todo)) as advance:
                for file, row in pool_map(partial(_at, perform, files), todo, self.jobs):
                    write_json(file, row)
                    advance()
        return [json.loads(file.read_text("utf-8")) for file in files] if all(map(Path.exists, files)) else []

    def kept(self, name: str, row: Row) -> "KeptRun":
        return KeptRun(self.runs / name / "runs" / f"{row['run']:08}")

    def write(self, part: str, blocks: Blocks) -> None:
        """Write all nonempty blocks of a part to the pages, with the provenance."""
        made = {name: content for name, content in blocks.items() if content}
        if made:
            made[f"standing {part}"] = f"{statement()} To measure again: `make {self.verb} STUDY={part}`."
        for file in self.pages:
            text = file.read_text(encoding="utf-8")
            for name in [name for name in made if f"<!-- {name} -->" in text]:
                text = put(text, name, made.pop(name))
            file.write_text(text, encoding="utf-8")
        if lost := [name for name in made if not name.startswith("standing")]:
            raise SystemExit(f"{self.pages[0]}: the page has no blocks {', '.join(lost)}")

    def _file(self, name: str, source: str, changes: dict[str, Any]) -> str | Path:
        if not (changes or self.trial or self.seeds or self.variants):
            return source
        content = shipped(source) | changes
        content["set"] = content.get("set", {}) | self.trial
        if self.variants:
            every = content.get("variant", [])
            content["variant"] = [each for each in every if each["name"] in self.variants] or every
        if self.seeds:
            seeds = content.get("seeds", 1)
            content["seeds"] = seeds[: self.seeds] if isinstance(seeds, list) else min(seeds, self.seeds)
        self.runs.mkdir(parents=True, exist_ok=True)
        file = self.runs / f"{name}.toml"
        file.write_text(tomli_w.dumps(content), encoding="utf-8")
        return file


Part = Callable[[Study], Blocks]
"""Function that simulates missing runs of a part, draws its figures, and returns its page blocks."""


class KeptRun:
    """Scenario and signals of a run stored by a sweep."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.scenario = folder, load_scenario(folder / "scenario.toml")

    def column(self, name: str) -> np.ndarray:
        return pq.read_table(self.folder / "signals.parquet", columns=[name]).column(0).to_numpy()


def _at(perform: Callable[[Any], Row], jobs: Mapping[Path, Any], file: Path) -> Row:
    return perform(jobs[file])


def _pair(text: str) -> tuple[str, Any]:
    key, _, value = text.partition("=")
    return key, tomllib.loads(f"value = {value}")["value"]
