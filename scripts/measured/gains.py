"""The gains that ship: `scenarios/tunings/gains.toml` for each of its laws, into docs/tuning/ and docs/guidance.md.

The searches that are there already are not repeated: an interrupted run goes on where it stopped. What they find goes
into `control/gains.py` and into the defaults of the laws by hand; a test compares.
"""

import json
from functools import partial
from pathlib import Path

from sweeps import Blocks, Study

from agrobot_mj import load_scenario
from agrobot_mj.core.markdown import markdown_table
from agrobot_mj.extensions.search.tune import tune
from agrobot_mj.extensions.search.tuning_cases import read_tuning
from agrobot_mj.simulation.progress import tally

FILE = read_tuning("gains")


def searched(study: Study, name: str) -> Blocks:
    """Search the gains of a law unless they are there; the table once those of all laws are."""
    folder = study.images.parent / "tuning"
    folder.mkdir(exist_ok=True)
    files = {law: folder / f"{law}.json" for law in FILE.laws}
    if not (files[name].exists() or study.only_draw):
        write(files[name], name, study)
    return {"gains": table(list(files.values()))} if all(map(Path.exists, files.values())) else {}


def write(path: Path, name: str, study: Study) -> None:
    """Search the gains of one law, and write what was found, an evaluation a line."""
    scenario = load_scenario("figure_eight", {**FILE.set, **FILE.laws[name].set})
    with tally(f"{name}: {FILE.budget} evaluations", FILE.budget) as advance:

        def done(evaluations: int) -> None:
            for _ in range(evaluations):
                advance()

        folder = study.runs / "gains" / name
        found = tune(scenario, FILE, folder, jobs=study.jobs, known=FILE.laws[name].known, done=done)
    trace = ",\n    ".join(json.dumps(row) for row in found.pop("trace"))
    text = json.dumps(found, indent=2)
    path.write_text(f'{text[:-2]},\n  "trace": [\n    {trace}\n  ]\n}}\n', encoding="utf-8")


def table(files: list[Path]) -> str:
    """What was found, a law a row."""
    lines = []
    for found in (json.loads(file.read_text(encoding="utf-8")) for file in files):
        gains = ", ".join(f"`{key.split('.', 1)[1]}` {value:g}" for key, value in found["gains"].items())
        scores = [
            " / ".join(_score(found[part][k]) for k in ("score_before", "score")) for part in ("training", "test")
        ]
        lines.append((found["law"], gains, *scores))
    return markdown_table(("law", "gains", "training", "test"), lines, 2)


def _score(score: dict) -> str:
    failed = score["failed"].partition(" ")[0]
    return f"{score['mean']:.2f}" + (f" ({failed})" if failed else "")


PARTS = {law: partial(searched, name=law) for law in FILE.laws}
