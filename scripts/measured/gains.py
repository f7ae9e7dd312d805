"""Search for the shipped gains with `scenarios/tunings/gains.toml`, for docs/tuning/ and guidance_tables.md.

The results are copied manually to `control/gains.py` and to the defaults of the laws. A test compares these copies with
the results.
"""

import json
import shutil
from functools import partial
from pathlib import Path

from sweeps import Blocks, Study

from agrobot_mj import load_scenario
from agrobot_mj.core.markdown import markdown_table
from agrobot_mj.extensions.search.tune import tune
from agrobot_mj.extensions.search.tuning_cases import read_tuning

FILE = read_tuning("gains")


def searched(study: Study, name: str) -> Blocks:
    """Search for the gains of the law `name` if the result is missing. Return the table when all laws have results."""
    files = _traces(study)
    if not (files[name].exists() or study.only_draw):
        scenario = load_scenario("figure_eight", {**FILE.set, **FILE.laws[name].set})
        tune(scenario, FILE, study.runs / "gains" / name, jobs=study.jobs, known=FILE.laws[name].known)
        files[name].parent.mkdir(exist_ok=True)
        shutil.copyfile(study.runs / "gains" / name / "tuning.json", files[name])
    return {"gains": table(list(files.values()))} if all(map(Path.exists, files.values())) else {}


def again(study: Study) -> Blocks:
    """Search again for the gains of all laws, starting from the default gains. Return the table when all laws have
    results."""
    found = {law: study.runs / "gains_again" / law / "tuning.json" for law in FILE.laws}
    for law, file in found.items():
        if not (file.exists() or study.only_draw):
            shipped = json.loads(_traces(study)[law].read_text(encoding="utf-8"))["gains"]
            scenario = load_scenario("figure_eight", {**FILE.set, **FILE.laws[law].set, **shipped})
            tune(scenario, FILE, file.parent, jobs=study.jobs, known=shipped)
    return {"gains again": table(list(found.values()))} if all(map(Path.exists, found.values())) else {}


def _traces(study: Study) -> dict[str, Path]:
    return {law: study.images.parent / "tuning" / f"{law}.json" for law in FILE.laws}


def table(files: list[Path]) -> str:
    """Return the table of the gain search with one row per law."""
    lines = []
    for found in (json.loads(file.read_text(encoding="utf-8")) for file in files):
        gains = ", ".join(f"`{key.split('.', 1)[1]}` {value:g}" for key, value in found["gains"].items())
        scores = (found[part] for part in ("training", "test"))
        lines.append((found["law"], gains, *(f"{_score(s['score_before'])} / {_score(s['score'])}" for s in scores)))
    return markdown_table(("law", "gains", "training", "test"), lines, 2)


def _score(score: dict) -> str:
    failed = score["failed"].partition(" ")[0]
    return f"{score['mean']:.2f}" + (f" ({failed})" if failed else "")


PARTS = {law: partial(searched, name=law) for law in FILE.laws} | {"again": again}
