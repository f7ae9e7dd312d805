"""docs/verdict.md: the paper's claims judged, how much each law survives, ablation, validity and importance.

Every part keeps its runs under runs/verdict and does what is missing there, so that it can be broken off at any time;
`--only-draw` writes page and figures from what is there, `--part NAME` does one part.
"""

import argparse
import json
import shutil
import tomllib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import tomli_w
from blocks import put

from agrobot_mj.core.resources import SCENARIOS
from agrobot_mj.core.version import __version__
from agrobot_mj.simulation.progress import task
from agrobot_mj.studies.style import save
from agrobot_mj.studies.sweep import SweepOptions, sweep
from agrobot_mj.studies.sweep.importance import importance, importance_table, importance_text
from agrobot_mj.studies.verdict import claims, figures, judgement, survival, validity
from agrobot_mj.studies.verdict.ablation import ablation_table
from agrobot_mj.studies.verdict.ranking import by_ground, compare_sets, compared_text, ranking_table
from agrobot_mj.studies.verdict.rows import complete, read_rows, select

ROOT = Path(__file__).parent.parent
PAGE, IMAGES, RUNS = ROOT / "docs" / "verdict.md", ROOT / "docs" / "images", ROOT / "runs" / "verdict"
COMPARED = ROOT / "runs" / "results" / "rows.jsonl"
"""Rows of `make results`, which are used where they are there."""
SEEDS = {"paper": 10, "noise": 3, "soil": 3, "gain": 3, "radius": 3, "speed": 3, "settling": 3}
"""Seeds of each study of the claims."""
PARTS: dict[str, tuple[Mapping[str, Any], Callable[..., Any]]] = {
    "claims": (claims.claim_jobs(SEEDS), claims.claim_run),
    "validity": (validity.validity_jobs(), validity.validity_drive),
    "survival": (survival.survival_jobs(), survival.survival_search),
}
"""Jobs of each part, and what does one."""
AGAIN = range(21, 41)
"""Seeds of the second set of `controllers`."""
SWEEPS = ("ablation", "importance", "importance_sobol", "controllers", "controllers_again")
"""Parts that are sweeps of the package; the last one is `controllers` with the seeds of `AGAIN`."""


def run_part(name: str, jobs: int) -> None:
    """Do what is missing of a part."""
    todo, perform = PARTS[name]
    with task(f"{name}: {len(todo)} pieces of work", len(todo)) as advance:
        complete(RUNS / f"{name}.jsonl", todo, perform, jobs, advance)


def run_sweep(name: str, jobs: int) -> None:
    """Do what is missing of a sweep that comes with the package."""
    source = again() if name == "controllers_again" else name
    found = sweep(source, RUNS / name, SweepOptions(jobs=jobs))
    print(f"{name}: {found.total} runs, {found.errors} with an error")


def again() -> Path:
    """A copy of the sweep `controllers` with the seeds of `AGAIN`."""
    content = tomllib.loads((SCENARIOS / "sweeps" / "controllers.toml").read_text("utf-8"))
    file = RUNS / "controllers_again.toml"
    RUNS.mkdir(parents=True, exist_ok=True)
    file.write_text(tomli_w.dumps({**content, "seeds": list(AGAIN)}), encoding="utf-8")
    return file


def publish() -> None:
    """Write page and figures from the rows that are there."""
    text = PAGE.read_text(encoding="utf-8")
    if rows := read_rows(RUNS / "claims.jsonl"):
        counts = ", ".join(f"{name} {len({r['seed'] for r in select(rows, study=name)})}" for name in SEEDS)
        text = put(text, "standing", f"Version {__version__}; {len(rows)} runs; seeds by study: {counts}.")
        text = put(text, "claims", judgement.claims_table(judgement.judged(rows)))
        figures.write_claim_figures(rows, IMAGES)
    if rows := read_rows(RUNS / "survival.jsonl"):
        text = put(text, "survival", survival.survival_table(rows))
        save(survival.survival_figure(rows), IMAGES / "verdict_survival.png")
    if rows := read_rows(RUNS / "validity.jsonl"):
        text = put(text, "validity", validity.validity_table(rows))
        save(validity.validity_figure(rows), IMAGES / "verdict_validity.png")
    if rows := read_rows(COMPARED):
        text = put(text, "closed", validity.closed_loop_table(rows))
    if whole("ablation"):
        text = put(text, "ablation", ablation_table(sweep_rows("ablation")))
    if whole("controllers") and whole("controllers_again"):
        sets = [by_ground(sweep_rows(name)) for name in ("controllers", "controllers_again")]
        text = put(text, "ranking", ranking_table(*sets))
        text = put(text, "ranked", compared_text(compare_sets(*sets)))
    for name in ("importance", "importance_sobol"):
        if whole(name):
            found = importance(RUNS / name)
            told = importance_text(found, "xte_rms").replace("\n", " ")
            text = put(text, name, f"{importance_table(found)}\n\n{told}")
            shutil.copyfile(RUNS / name / "importance.png", IMAGES / f"verdict_{name}.png")
    PAGE.write_text(text, encoding="utf-8")


def sweep_rows(name: str) -> list[dict[str, Any]]:
    """The rows of a sweep."""
    return pq.read_table(RUNS / name / "sweep.parquet").to_pylist()


def whole(name: str) -> bool:
    """Whether a sweep is there and has all of its runs."""
    table, plan = (RUNS / name / file for file in ("sweep.parquet", "plan.json"))
    return table.exists() and pq.read_metadata(table).num_rows == json.loads(plan.read_text("utf-8"))["runs"]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--part", choices=[*PARTS, *SWEEPS], action="append", help="do this part only; may be given again"
    )
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("--only-draw", action="store_true", help="run nothing, draw what is there")
    arguments = parser.parse_args()
    for name in () if arguments.only_draw else arguments.part or (*PARTS, *SWEEPS):
        (run_sweep if name in SWEEPS else run_part)(name, arguments.jobs)
    publish()


if __name__ == "__main__":
    main()
