"""Commands `sweep`, which simulates variations of a scenario, and `report`, which writes an HTML report."""

import re
import sys
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from agrobot_mj.cli.options import Jobs, Out, Quiet, results_folder
from agrobot_mj.cli.output import print_hints
from agrobot_mj.cli.sharing import recording_of
from agrobot_mj.cli.sharing import share as share_files
from agrobot_mj.core.errors import ScenarioError


def sweep(
    sources: Annotated[
        list[str], typer.Argument(metavar="SWEEP.toml", help="Sweep file or, with --merge, the folders to merge.")
    ],
    out: Out = None,
    jobs: Jobs = None,
    scheduler: Annotated[
        str | None, typer.Option(metavar="ADDRESS", help="Use the workers of this Dask scheduler.")
    ] = None,
    shard: Annotated[
        str | None, typer.Option(metavar="I/N", help="Run only part I of N, e.g. in a Slurm array.")
    ] = None,
    merge: Annotated[bool, typer.Option("--merge", help="Merge folders written with --shard.")] = False,
    fresh: Annotated[bool, typer.Option("--fresh", help="Discard earlier results in the folder.")] = False,
    max_runs: Annotated[int, typer.Option(min=1, help="Maximum number of runs.")] = 100_000,
    quiet: Quiet = False,
) -> None:
    """Simulate a scenario over axes, samples, seeds and variants.

    Writes sweep.parquet with one row per run. After an interruption the same command continues with the missing runs.
    """
    from agrobot_mj.studies.error_parts import table_warnings
    from agrobot_mj.studies.sweep.runner import SweepOptions
    from agrobot_mj.studies.sweep.runner import sweep as run_sweep

    if scheduler and jobs:
        raise ScenarioError("--jobs: the option applies to processes on this machine; omit it with --scheduler")
    if merge:
        _merge(sources, out, quiet)
        return
    if len(sources) > 1:
        raise ScenarioError(f"sweep: specify one sweep file, got {len(sources)}; merge folders with --merge")
    folder = results_folder(out, f"sweep-{Path(sources[0]).stem}")
    options = SweepOptions(jobs, scheduler, _shard(shard), fresh, max_runs, quiet)
    found = run_sweep(sources[0], folder, options, partial(print_hints, quiet=quiet))
    if found.errors:
        print(f"{found.errors:,} runs raised an error; see the column `error` of sweep.parquet", file=sys.stderr)
    if not quiet:
        there = f", {found.before:,} already present" if found.before else ""
        unexpected = f", of which {found.unexpected:,} did not end as expected" if found.unexpected else ""
        print(f"{found.new:,} runs done{unexpected}{there}; results in {found.folder / 'sweep.parquet'}")
        for warning in table_warnings(found.folder / "sweep.parquet"):
            print(warning)


def _merge(sources: list[str], out: Path | None, quiet: bool) -> None:
    from agrobot_mj.studies.sweep.runner import merge_results

    folders = [Path(source) for source in sources if Path(source).is_dir()]
    files = [source for source in sources if not Path(source).is_dir()]
    name = f"sweep-{Path(files[0]).stem}" if files else "sweep-merged"
    folder = results_folder(out, name) if out or files or len(folders) > 1 else folders[0]
    rows, total = merge_results([*folders, *([folder] if folder.is_dir() and (files or not folders) else [])], folder)
    if not quiet:
        print(f"{rows:,} of {total:,} runs; results in {folder / 'sweep.parquet'}")
    if rows < total:
        print(f"{folder}: {total - rows:,} of {total:,} runs are missing; run the remaining shards", file=sys.stderr)
        raise typer.Exit(1)


def _shard(text: str | None) -> tuple[int, int]:
    if text is None:
        return 1, 1
    match = re.fullmatch(r"(\d{1,9})/(\d{1,9})", text.strip())
    if not match or not 1 <= int(match[1]) <= int(match[2]):
        raise ScenarioError(f"--shard {text}: must have the form PART/PARTS, from 1/4 to 4/4 for 4 parts")
    return int(match[1]), int(match[2])


def report(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder with the results of a command.")],
    metric: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="Column of sweep.parquet whose sensitivity to the draws is ranked."),
    ] = None,
    share: Annotated[
        bool, typer.Option("--share", help="Also write share.html with the 3D recording, and poster.png.")
    ] = False,
    quiet: Quiet = False,
) -> None:
    """Write report.html for a results folder.

    The file works offline, with zoomable curves, maps and rankings. With --share a second file contains the recording
    and its viewer.
    """
    from agrobot_mj.simulation.progress import print_elapsed
    from agrobot_mj.studies.pages.report import write_report

    recording = recording_of(folder) if share else None
    with print_elapsed(f"{folder}: writing the report", quiet):
        written = write_report(folder, metric)
        if recording:
            written += share_files(recording)
    if not quiet:
        print(*written, sep="\n")
