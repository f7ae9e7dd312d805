"""The gains that ship: `scenarios/tunings/gains.toml` for each of its laws, into docs/tuning/ and docs/guidance.md.

The searches that are there already are not repeated: an interrupted run goes on where it stopped. What they find goes
into `control/gains.py` and into the defaults of the laws by hand; a test compares.
"""

import argparse
import json
from pathlib import Path

from blocks import put

from agrobot_mj import load_scenario
from agrobot_mj.core.markdown import markdown_table
from agrobot_mj.simulation.progress import task
from agrobot_mj.studies.tune import tune
from agrobot_mj.studies.tuning_cases import TuningFile, read_tuning

DOCS = Path(__file__).parent.parent / "docs"
FOLDER, PAGE = DOCS / "tuning", DOCS / "guidance.md"


def write(path: Path, name: str, file: TuningFile, jobs: int) -> None:
    """Search the gains of one law, and write what was found, an evaluation a line."""
    scenario = load_scenario("figure_eight", {**file.set, **file.laws[name].set})
    with task(f"{name}: {file.budget} evaluations", file.budget) as advance:

        def done(evaluations: int) -> None:
            for _ in range(evaluations):
                advance()

        found = tune(scenario, file, jobs=jobs, known=file.laws[name].known, done=done).provenance
    trace = ",\n    ".join(json.dumps(row) for row in found.pop("trace"))
    text = json.dumps(found, indent=2)
    path.write_text(f'{text[:-2]},\n  "trace": [\n    {trace}\n  ]\n}}\n', encoding="utf-8")


def table(names: list[str]) -> str:
    """What was found, a law a row."""
    lines = []
    for name in names:
        found = json.loads((FOLDER / f"{name}.json").read_text(encoding="utf-8"))
        gains = ", ".join(f"`{key.split('.', 1)[1]}` {value:g}" for key, value in found["gains"].items())
        scores = [
            " / ".join(_score(found[part][k]) for k in ("score_before", "score")) for part in ("training", "test")
        ]
        lines.append((found["law"], gains, *scores))
    return markdown_table(("law", "gains", "training", "test"), lines, 2)


def _score(score: dict) -> str:
    failed = score["failed"].partition(" ")[0]
    return f"{score['mean']:.2f}" + (f" ({failed})" if failed else "")


def main() -> None:
    """Search what is missing."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("laws", nargs="*", help="names of `laws`; all of them if left out")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--out", type=Path, default=FOLDER)
    given, file = parser.parse_args(), read_tuning("gains")
    given.out.mkdir(parents=True, exist_ok=True)
    for name in given.laws or file.laws:
        path = given.out / f"{name}.json"
        if not path.exists():
            write(path, name, file, given.jobs)
    if given.out == FOLDER:
        text = put(PAGE.read_text(encoding="utf-8"), "gains", table(list(file.laws)))
        PAGE.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
