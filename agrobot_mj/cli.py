"""The command line: typer only. Every command loads, calls one function, and prints.

Exit status: 0 completed; 1 the run ended otherwise; 2 bad input, told in one message without a traceback.
"""

import re
import signal
import sys
import tempfile
import tomllib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any, NoReturn

import typer

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.core.version import __version__
from agrobot_mj.scenario.loading import load_scenario, scenario_files
from agrobot_mj.simulation.progress import Progress, task

app = typer.Typer(
    name="agrobot-mj",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    help="Does a guidance stack survive a real tractor? MuJoCo physics, the paper's controllers, Rerun recordings.",
)

Source = Annotated[str, typer.Argument(metavar="SCENARIO", help="A name from `agrobot-mj list` or a TOML file.")]
Sets = Annotated[
    list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="Override a key, e.g. plant.tyre.kind=linear.")
]
Out = Annotated[Path | None, typer.Option("--out", metavar="DIR", help="Folder for the results.")]
NoRrd = Annotated[bool, typer.Option("--no-rrd", help="Write no Rerun recording.")]
Recorded = Annotated[Path, typer.Argument(metavar="FILE.rrd", help="A recording.")]


def main() -> None:
    """Entry point: bad input ends with status 2 and one message."""
    try:
        app()
    except ScenarioError as error:
        fail(str(error))
    except KeyboardInterrupt:
        print("stopped", file=sys.stderr)
        raise SystemExit(1) from None
    except OSError as error:
        place = f"{error.filename}: " if error.filename else ""
        fail(f"{place}{error.strerror or error}")


def fail(message: str) -> NoReturn:
    """Print `message` on stderr and leave with status 2."""
    print(message, file=sys.stderr)
    raise SystemExit(2)


@app.command("list")
def list_scenarios() -> None:
    """Scenarios that come with the package, one line each."""
    files = scenario_files()
    width = max(map(len, files))
    for name in files:
        print(f"{name:{width}}  {load_scenario(name).title}")


@app.command("run")
def run_scenario(
    source: Source,
    sets: Sets = None,
    out: Out = None,
    no_rrd: NoRrd = False,
    live: Annotated[bool, typer.Option("--live", help="Show the run in a Rerun viewer as it goes.")] = False,
) -> None:
    """Run one scenario."""
    from agrobot_mj.simulation.run import Watcher, run
    from agrobot_mj.simulation.storage import write_log

    scenario = load_scenario(source, overrides(sets))
    folder = _folder(out, f"{scenario.name}-{scenario.hash8}")
    watchers: list[Watcher] = [Progress()]
    if live or not no_rrd:
        from agrobot_mj.recording import Recording

        watchers.append(Recording(None if no_rrd else folder / "run.rrd", live=live))
    with stop_on_signals() as stopped:
        log = run(scenario, tuple(watchers), lambda: bool(stopped))
    write_log(log, folder)
    if no_rrd:
        (folder / "run.rrd").unlink(missing_ok=True)  # of an earlier run, beside these signals it would mislead
    print(f"{scenario.name}: {log.outcome}, lateral rms {log.metrics['lateral_rms']:.3f} m, {folder}")
    if log.outcome != "completed":
        print(f"{scenario.name}: ended after {log.column('t')[-1]:.2f} s: {log.outcome}", file=sys.stderr)
        raise typer.Exit(1)


@app.command("compare")
def compare_scenario(
    source: Source,
    controllers: Annotated[str, typer.Option(help="Comma-separated controller kinds.")] = "pd,pd_t2fnn",
    plants: Annotated[
        str | None, typer.Option(help="Comma-separated plant kinds; bicycle,mujoco where they can run it by default.")
    ] = None,
    seeds: Annotated[int, typer.Option(min=1, help="How many seeds, counting up from the scenario's.")] = 1,
    sets: Sets = None,
    out: Out = None,
    no_rrd: NoRrd = False,
) -> None:
    """Run one scenario under several controllers and plants, with the paper's figures."""
    from agrobot_mj.studies.compare import cases, compare, runnable
    from agrobot_mj.studies.tables import table

    scenario = load_scenario(source, overrides(sets))
    if plants is None:
        kinds, left_out = runnable(scenario)
        for line in left_out:
            print(line, file=sys.stderr)
    else:
        kinds = names(plants, "--plants")
    todo = cases(scenario, names(controllers, "--controllers"), kinds, seeds)
    folder = _folder(out, f"{scenario.name}-compare-{scenario.hash8}")
    with interruptible(), task(f"{scenario.name}: {len(todo)} runs", len(todo)) as advance:
        rows = compare(todo, folder, rrd=not no_rrd, done=lambda case: advance())
    print(table(rows))
    print(f"figures and runs: {folder}")
    if any(row["outcome"] != "completed" for row in rows):
        raise typer.Exit(1)


@app.command("rig")
def rig(
    tyre: Annotated[str, typer.Argument(metavar="TYRE", help="A tyre kind, e.g. magic_formula, or a TOML file.")],
    out: Out = None,
) -> None:
    """Put one tyre on the test rig: force curves as Parquet and figures."""
    from agrobot_mj.studies.rig import rig_command

    folder = _folder(out, f"rig-{Path(tyre).stem}")
    for path in rig_command(tyre, folder):
        print(path)


@app.command("identify")
def identify(
    run: Annotated[Path, typer.Argument(metavar="RUN_DIR", help="A folder that `agrobot-mj run` has written.")],
) -> None:
    """Fit the steering valve (dead band, gains, rate limit, lag, delay) to a run's signals."""
    from agrobot_mj.studies.identify import identify_command

    print(identify_command(run))


@app.command("validate")
def validate_plants(
    out: Out = None,
    quick: Annotated[bool, typer.Option("--quick", help="Shorter manoeuvres, half a minute in all.")] = False,
) -> None:
    """Drive the manoeuvres with a known answer on every plant and tyre; fails when a number leaves its band."""
    from agrobot_mj.studies.validation import Check, validate

    def tell(name: str, checks: list[Check], seconds: float) -> None:
        failed = [check for check in checks if not check.passed]
        print(
            f"{name:20} {len(checks) - len(failed):3} of {len(checks):3} as they should be, {seconds:.0f} s", flush=True
        )

    folder = _folder(out, "validation")
    failed = [check for check in validate(folder, quick, tell) if not check.passed]
    print(f"table and figures: {folder}")
    for check in failed:
        print(check.line, file=sys.stderr)
    if failed:
        raise typer.Exit(1)


@app.command("view")
def view_file(
    file: Recorded,
    web: Annotated[bool, typer.Option("--web", help="Serve it to a browser on this machine.")] = False,
) -> None:
    """Open a recording in the Rerun viewer; needs no network."""
    from agrobot_mj.recording.transport.viewer import serve, view

    _check_recording(file)
    with interruptible():
        raise typer.Exit((serve if web else view)(file))


@app.command("snapshot")
def snapshot(
    file: Recorded,
    at: Annotated[str, typer.Option("--at", metavar="S,S,...", help="Times in seconds, comma-separated.")] = "60",
    tabs: Annotated[list[str] | None, typer.Option("--tab", metavar="NAME", help="Only this tab; repeatable.")] = None,
    out: Out = None,
) -> None:
    """Draw the tabs of a recording as PNGs; needs no display."""
    from agrobot_mj.recording.transport.snapshot import SnapshotError, snapshots

    _check_recording(file)
    folder = _folder(out, f"snapshots-{file.stem}")
    try:
        for path in snapshots(file, seconds(at), folder, tabs or []):
            print(path)
    except SnapshotError as error:
        print(error, file=sys.stderr)
        raise typer.Exit(1) from None


def seconds(text: str) -> list[float]:
    """Comma-separated times [s]."""
    try:
        times = [float(name) for name in names(text, "--at")]
    except ValueError:
        times = []
    if not times or not all(0 <= t < float("inf") for t in times):
        raise ScenarioError(f"--at {text}: write seconds as 5,60,120")
    return times


def _check_recording(file: Path) -> None:
    """Leave with status 2 unless `file` is a recording."""
    if not file.is_file():
        fail(f"{file}: no such file")
    with file.open("rb") as stream:
        magic = stream.read(4)
    if magic not in (b"RRF2", b"RRF0", b"RRIO"):
        fail(f"{file}: not a Rerun recording (.rrd)")


@app.callback(invoke_without_command=True)
def _version(
    context: typer.Context, version: Annotated[bool, typer.Option("--version", help="Print the version.")] = False
) -> None:
    if version:
        print(__version__)
        raise typer.Exit(0)


def overrides(sets: list[str] | None) -> dict[str, Any]:
    """`key=value` texts to values: TOML where it parses, else a bare word as a string."""
    found: dict[str, Any] = {}
    for text in sets or []:
        key, equals, value = text.partition("=")
        if not equals or not key.strip():
            raise ScenarioError(f"--set {text}: write it as key=value")
        try:
            found[key.strip()] = tomllib.loads(f"v = {value}")["v"]
        except tomllib.TOMLDecodeError:
            found[key.strip()] = value.strip()
    return found


def names(text: str, option: str) -> list[str]:
    """A comma-separated list without repetition."""
    found = list(dict.fromkeys(name.strip() for name in text.split(",") if name.strip()))
    if not found:
        raise ScenarioError(f"{option}: name at least one")
    return found


@contextmanager
def stop_on_signals() -> Iterator[list[int]]:
    """Collect SIGINT and SIGTERM in the list given, so that a run can end cleanly; a second one kills."""
    received: list[int] = []

    def handle(number: int, _frame: Any) -> None:
        if received:
            raise KeyboardInterrupt
        received.append(number)

    with handled_by(handle):
        yield received


@contextmanager
def interruptible() -> Iterator[None]:
    """SIGTERM ends the block as Ctrl-C does, so that what it has started is cleared away."""

    def interrupt(number: int, _frame: Any) -> NoReturn:
        raise KeyboardInterrupt

    with handled_by(interrupt):
        yield


@contextmanager
def handled_by(handler: Callable[[int, Any], None]) -> Iterator[None]:
    """SIGINT and SIGTERM go to `handler` within the block."""
    before = {number: signal.signal(number, handler) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        for number, old in before.items():
            signal.signal(number, old)


def _folder(out: Path | None, default: str) -> Path:
    """Where the results go: `out`, or a folder of the default's letters, digits, dots and dashes under runs/."""
    folder = out if out is not None else Path("runs") / re.sub(r"[^\w.-]+", "_", default).lstrip(".")
    if folder.exists() and not folder.is_dir():
        raise ScenarioError(f"--out {folder}: is a file; name a folder")
    there = next(path for path in (folder, *folder.absolute().parents) if path.exists())
    try:
        tempfile.TemporaryDirectory(dir=there).cleanup()
    except OSError as error:
        raise ScenarioError(f"--out {folder}: cannot be written: {error.strerror}; name another folder") from None
    return folder
