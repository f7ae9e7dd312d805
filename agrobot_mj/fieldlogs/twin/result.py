"""What `agrobot-mj twin` writes: machine, scenario with its way, map, numbers, and the page."""

from pathlib import Path
from typing import Any

from agrobot_mj.fieldlogs.calibrate.words import map_lines
from agrobot_mj.fieldlogs.twin.page import page, short
from agrobot_mj.fieldlogs.twin.twin import MACHINE, SCENARIO, WAY, Twin
from agrobot_mj.simulation.storage import atomic, write_json

REPORT = "report.html"
FILES = (REPORT, MACHINE, SCENARIO, WAY, "map.toml", "twin.json")
"""What a twin leaves."""


def write_twin(t: Twin, folder: Path) -> None:
    """Write all files into a folder of results. Raises `ScenarioError` without plotly, before anything is written."""
    page(t).write(folder / REPORT)
    for name, text in {**t.texts, "map.toml": map_lines(t.calibration)}.items():
        with atomic(folder / name) as part:
            part.write_text(text, encoding="utf-8")
    write_json(folder / "twin.json", numbers(t))


def numbers(t: Twin) -> dict[str, Any]:
    """What `twin.json` holds."""
    return {
        "log": t.name,
        "machine": t.scenario.machine,
        "found": {key: each._asdict() for key, each in t.found.items()},
        "windows": t.calibration.data.windows,
        "held_out": t.held_out.metrics,
        "notes": list(t.calibration.pieces.notes),
    }


def summary(t: Twin) -> str:
    """The page's first section."""
    return "\n".join([*t.calibration.pieces.notes, *short(t)])
