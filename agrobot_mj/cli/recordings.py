"""Commands that display Rerun recordings: `view` and `snapshot`."""

import os
import sys
from pathlib import Path
from typing import Annotated

import typer

from agrobot_mj.cli.interrupts import interruptible
from agrobot_mj.cli.options import Out, Quiet, Recorded, results_folder, seconds
from agrobot_mj.cli.output import say
from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.core.resources import absence

MAGIC = (b"RRF2", b"RRF0", b"RRIO")  # Possible first four bytes of a Rerun recording
OLDEST = (0, 23)  # Oldest version of Rerun whose recordings the viewer can read: major and minor number


def view(
    file: Recorded,
    web: Annotated[bool, typer.Option("--web", help="Open it in a browser on this machine.")] = False,
) -> None:
    """Open a recording in the Rerun viewer. No network is needed."""
    from agrobot_mj.recording.transport import viewer
    from agrobot_mj.recording.transport.mending import whole

    _check_recording(file)
    if not web and sys.platform.startswith("linux") and not any(map(os.environ.get, ("DISPLAY", "WAYLAND_DISPLAY"))):
        remedy = f"`agrobot-mj view --web {file}` (browser) or `agrobot-mj snapshot {file}` (images)"
        raise ScenarioError(f"view: there is no display for the viewer; use {remedy}")
    with interruptible(), whole(file) as readable:
        raise typer.Exit((viewer.serve if web else viewer.view)(readable))


def snapshot(
    file: Recorded,
    at: Annotated[
        str | None,
        typer.Option("--at", metavar="S,S,...", help="Times in seconds, comma-separated. Default: 60 or the end."),
    ] = None,
    tabs: Annotated[
        list[str] | None, typer.Option("--tab", metavar="NAME", help="Tab or 3D view (Tractor) to render; repeatable.")
    ] = None,
    gif: Annotated[bool, typer.Option("--gif", help="Animate 10 s from each time, or the last 10 s.")] = False,
    mp4: Annotated[bool, typer.Option("--mp4", help="Like --gif, but as a video; requires ffmpeg.")] = False,
    out: Out = None,
    quiet: Quiet = False,
) -> None:
    """Render the tabs of a recording as images."""
    from agrobot_mj.recording.transport.snapshot import Kind, SnapshotError, snapshots
    from agrobot_mj.simulation.results import results

    if gif and mp4:
        raise ScenarioError("snapshot: --gif and --mp4 are mutually exclusive; specify only one of them")
    _check_recording(file)
    kind: Kind = "mp4" if mp4 else "gif" if gif else "png"
    folder = results_folder(out, f"snapshots-{file.stem}")
    try:
        with results(folder, ()), interruptible():
            paths = snapshots(file, seconds(at) if at else (), folder, tabs or [], kind, quiet=quiet)
    except SnapshotError as error:
        print(error, file=sys.stderr)
        raise typer.Exit(1) from None
    if not quiet:
        say("\n".join(map(str, paths)))


def _check_recording(file: Path) -> None:
    if not file.is_file():
        from agrobot_mj.simulation.storage import RECORDING

        fix = f"specify {file / RECORDING}" if (file / RECORDING).is_file() else "specify a recording"
        raise ScenarioError(f"{file}: {absence(file, fix)}")
    with file.open("rb") as stream:
        magic, version = stream.read(4), tuple(stream.read(2))
    if magic not in MAGIC:
        raise ScenarioError(f"{file}: the file is not a Rerun recording (.rrd)")
    if magic == MAGIC[0] and len(version) == len(OLDEST) and version < OLDEST:
        written, oldest = (".".join(map(str, each)) for each in (version, OLDEST))
        raise ScenarioError(
            f"{file}: the recording was written by Rerun {written}, but the viewer needs {oldest} or later; "
            "repeat the run"
        )
