"""Files for sharing a results folder: an HTML page that contains the recording and its viewer, and a poster image."""

import json
import sys
import tempfile
import tomllib
from pathlib import Path

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.core.resources import folder_absence
from agrobot_mj.simulation.results import atomic, check_folder

COMPARISON = "comparison.rrd"
PAGE, POSTER = "share.html", "poster.png"  # Files written by `report --share`


def recording_of(folder: Path) -> Path:
    """Return the recording in a results folder, preferably of a comparison. Raises `ScenarioError` if there is none."""
    from agrobot_mj.simulation.storage import RECORDING

    found = next((file for name in (COMPARISON, RECORDING) if (file := folder / name).is_file()), None)
    if found is None:
        if not folder.is_dir():
            raise ScenarioError(f"--share {folder}: {folder_absence(folder)}")
        missing = f"the folder contains no recording ({RECORDING} or {COMPARISON})"
        scenario = folder / "scenario.toml"
        repeat = f"record with: agrobot-mj run {scenario} --out {folder}"
        fix = repeat if scenario.is_file() else "specify another folder"
        raise ScenarioError(f"--share {folder}: {missing}; {fix}")
    check_folder(folder, (PAGE, POSTER))
    return found


def share(recording: Path) -> list[Path]:
    """Write the HTML page and the poster next to a recording. Return their paths, or only the page if rendering
    fails."""
    from agrobot_mj.recording.transport.share import write_shared

    folder = recording.parent
    poster = _poster(recording, folder / POSTER)
    page = write_shared(recording, folder / PAGE, *_about(folder), poster)
    print(f"{page}: {page.stat().st_size / 1e6:.0f} MB; opens in a browser without a network", file=sys.stderr)
    return [page, *([poster] if poster else [])]


def _poster(recording: Path, file: Path) -> Path | None:
    """Render the first tab of a recording to the image `file`. Return `file`, or None if rendering fails."""
    from agrobot_mj.recording.transport.snapshot import SnapshotError, snapshots

    with tempfile.TemporaryDirectory() as place:
        try:
            (drawn,) = snapshots(recording, (), Path(place), ["Drive"])
        except SnapshotError as error:
            print(f"{error}; {POSTER} is not written", file=sys.stderr)
            return None
        with atomic(file) as temporary:
            temporary.write_bytes(drawn.read_bytes())
    return file


def _about(folder: Path) -> tuple[str, str]:
    """Return the title of the scenario in a results folder, and a text with outcome, lateral error and guidance law."""
    try:
        said = tomllib.loads((folder / "scenario.toml").read_text("utf-8"))
        metrics = json.loads((folder / "metrics.json").read_text("utf-8"))
    except (OSError, ValueError):
        return folder.resolve().name, "Comparison of runs on the same scenario"
    rms = metrics.get("lateral_rms")
    facts = [str(metrics.get("outcome", "")), *([] if rms is None else [f"lateral rms {100 * rms:.1f} cm"])]
    law = said.get("guidance", {}).get("kind")
    return said.get("title") or said.get("name") or folder.name, ", ".join(
        [*facts, *([f"guidance {law}"] if law else [])]
    )
