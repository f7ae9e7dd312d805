"""The paper's experiment in docs/results.md: run the comparison, write its table and its figure."""

import argparse
import json
import shutil
from pathlib import Path

from blocks import put

from agrobot_mj import load_scenario
from agrobot_mj.simulation.progress import task
from agrobot_mj.studies.compare import compare
from agrobot_mj.studies.compare_plan import plan
from agrobot_mj.studies.tables import table

ROOT = Path(__file__).parent.parent
PAGE, IMAGE = ROOT / "docs" / "results.md", ROOT / "docs" / "images" / "lateral_error.png"
CONTROLLERS = ("pd", "pd_isgn", "pd_t1fnn", "pd_t2fnn")
PLANTS = ("bicycle", "mujoco")


def run(folder: Path) -> None:
    """Run all cases of the page's table into `folder`."""
    todo = plan(load_scenario("figure_eight"), CONTROLLERS, plants=PLANTS).cases
    with task(f"{len(todo)} runs", len(todo)) as advance:
        compare(todo, folder, rrd=False, done=lambda _: advance())


def publish(folder: Path) -> str:
    """Write the table into the page and the figure into docs/images; returns the table."""
    text = table(json.loads((folder / "comparison.json").read_text(encoding="utf-8")))
    PAGE.write_text(put(PAGE.read_text(encoding="utf-8"), "results", text), encoding="utf-8")
    IMAGE.parent.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(folder / "lateral_error.png", IMAGE)
    return text


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--results", type=Path, help="folder of a finished comparison; runs one when left out")
    folder = parser.parse_args().results
    if folder is None:
        folder = ROOT / "runs" / "readme"
        run(folder)
    print(publish(folder))


if __name__ == "__main__":
    main()
