"""Command `play` for interactive driving."""

import io
import sys
import webbrowser
from contextlib import ExitStack, redirect_stdout
from typing import Annotated

import typer

from agrobot_mj.cli.interrupts import stop_on_signals
from agrobot_mj.cli.options import Answer, NoRrd, Out, Quiet, Sets, Source, finite, overrides, results_folder
from agrobot_mj.cli.output import print_hints
from agrobot_mj.cli.panels import help_entry


def play(
    source: Source = "side_slope_10",
    sets: Sets = None,
    port: Annotated[
        int, typer.Option(min=0, max=65535, help="Port of the page; 0 selects the first free port from 8080.")
    ] = 0,
    network: Annotated[
        bool, typer.Option("--network", help="Make the page available to other computers, without a password.")
    ] = False,
    no_browser: Annotated[bool, typer.Option("--no-browser", help="Only print the address of the page.")] = False,
    seconds: Annotated[float | None, typer.Option(min=0, callback=finite, help="End after this wall time [s].")] = None,
    out: Out = None,
    no_rrd: NoRrd = False,
    quiet: Quiet = False,
) -> Answer:
    """Drive the tractor in a browser, manually or automatically.

    Press Ctrl-C to end. Each drive is saved as a run; `agrobot-mj run` with its scenario reproduces the drive.
    """
    from agrobot_mj.extensions.play.play import PlayOptions
    from agrobot_mj.extensions.play.play import play as drive
    from agrobot_mj.extensions.play.session import drivable
    from agrobot_mj.scenario.loading import load_scenario
    from agrobot_mj.simulation.progress import print_elapsed
    from agrobot_mj.simulation.results import check_folder
    from agrobot_mj.simulation.storage import files_of_run
    from agrobot_mj.studies.engine.workers import compiling_beside

    scenario = load_scenario(source, overrides(sets))
    said = print_hints([scenario], quiet)
    folder = results_folder(out, f"{scenario.name}-play-{scenario.hash8}")
    check_folder(folder, files_of_run(scenario))

    def tell(text: str) -> None:
        if not quiet:
            print(f"{scenario.name}: {text}", file=sys.stderr, flush=True)

    def ready(url: str) -> None:
        waiting.close()
        tell(f"open {url} to drive; press Ctrl-C to end")
        if not no_browser:
            webbrowser.open(url)

    driven = drivable(scenario)
    tell("placing the tractor; the first start takes about half a minute for compilation")
    options = PlayOptions(port, network, seconds, not no_rrd)
    with ExitStack() as waiting, stop_on_signals() as stopped, redirect_stdout(io.StringIO()):
        waiting.enter_context(compiling_beside(scenario))
        waiting.enter_context(print_elapsed(f"{scenario.name}: placing the tractor", quiet))
        drives = drive(driven, folder, options, stopped, ready)
    rows = [
        {"folder": str(place), "outcome": log.outcome, "duration_s": log.scenario.duration_s} for place, log in drives
    ]
    lines = [f"{scenario.name}: {row['duration_s']:g} s, {row['outcome']}, {row['folder']}" for row in rows]
    text = "\n".join(lines) or f"{scenario.name}: no steps were simulated, so nothing was saved"
    return Answer({"scenario": scenario.name, "hints": said, "drives": rows}, text)


COMMANDS = {
    play: help_entry(
        *(
            "Run",
            "play",
            "play side_slope_10 --set terrain.grade_deg=30",
            "play rain --machine row_crop --out runs/mine",
        ),
        advanced=True,
    ),
}
"""Command `play` with its help entry."""
