"""Arguments and options shared by commands, conversion of their texts to values, and the result class of commands."""

import json
import os
import re
import tempfile
import tomllib
from collections.abc import Callable, Mapping
from functools import wraps
from inspect import Parameter, signature
from math import isfinite, isnan
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import typer

from agrobot_mj.core.errors import ScenarioError, shorten
from agrobot_mj.core.resources import scenario_files
from agrobot_mj.simulation.results import check_folder


def _starting_with(incomplete: str) -> list[str]:
    return [name for name in scenario_files() if name.startswith(incomplete)]


Source = Annotated[
    str,
    typer.Argument(
        metavar="SCENARIO", help="Name from `agrobot-mj list`, or a TOML file.", autocompletion=_starting_with
    ),
]
Sets = Annotated[
    list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="Override a key, e.g. plant.tyre.kind=linear.")
]
OnMachine = Annotated[
    str | None,
    typer.Option("--machine", metavar="NAME", help="Name from `agrobot-mj list --machines`, or a TOML file."),
]
Plugins = Annotated[
    list[Path] | None,
    typer.Option("--plugin", metavar="FILE.py", help="Python file with user-defined kinds; repeatable."),
]


def number(value: float | None) -> float | None:
    """Return the number given for an option, which may be infinite, or None. Raises BadParameter for NaN."""
    if value is not None and isnan(value):
        raise typer.BadParameter("is not a number")
    return value


def finite(value: float | None) -> float | None:
    """Return the finite number given for an option, or None. Raises BadParameter for NaN, infinity and overflows."""
    if value is not None and not isfinite(value):
        raise typer.BadParameter("must be a finite number")
    return value


Out = Annotated[
    Path | None,
    typer.Option("--out", metavar="DIR", help="Folder for the results.", show_default=False),
]
NoRrd = Annotated[bool, typer.Option("--no-rrd", help="Do not write a Rerun recording.")]
SEEDS = typer.Option(min=1, help="Number of seeds, counted from the seed of the scenario.")
Seeds = Annotated[int, SEEDS]
Jobs = Annotated[int | None, typer.Option(min=1, max=1000, help="Number of processes. Default: number of cores.")]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Print errors only.")]
Recorded = Annotated[Path, typer.Argument(metavar="FILE.rrd", help="A recording.")]


class Answer(NamedTuple):
    """Result of a command, for output as text or as JSON."""

    content: Mapping[str, Any]  # Result of the command: keys and values of the JSON document
    text: str  # Text printed at the end of the command
    failed: str = ""  # Error message of exit status 1, or an empty string for exit status 0


LONGEST_NAME = 150  # Maximum number of characters of a default folder name


def overrides(sets: list[str] | None, option: str = "--set") -> dict[str, Any]:
    """Convert texts `key=value` to a mapping of dotted keys to values. Values that are not valid TOML are strings."""
    found: dict[str, Any] = {}
    for text in sets or []:
        key, equals, value = utf8(text, option).partition("=")
        if not equals or not key.strip():
            raise ScenarioError(f"{option} {shorten(text)}: the override must have the form key=value")
        try:
            parsed = tomllib.loads(f"v = {value}")
        except tomllib.TOMLDecodeError:
            parsed = {"v": value.strip()}
        except (ValueError, RecursionError):
            raise ScenarioError(f"{option} {shorten(text)}: the value has too many digits or brackets") from None
        if len(parsed) > 1:
            raise ScenarioError(
                f"{option} {shorten(text)}: the text contains more than one value; use one {option} per value"
            )
        found[key.strip()] = parsed["v"]
    return found


def utf8(text: str, option: str) -> str:
    """Decode a command-line argument as UTF-8 in every locale. Raises `ScenarioError` if the text is not UTF-8."""
    try:
        return os.fsencode(text).decode("utf-8")
    except UnicodeError:
        shown = shorten(ascii(text))
        raise ScenarioError(f"{option} {shown}: the text is not valid UTF-8; specify the text in UTF-8") from None


def with_plugins(command: Callable[..., Any]) -> Callable[..., Any]:
    """Return a command with the additional option `--plugin`. Plugin files are loaded before the command runs."""

    @wraps(command)
    def begun(*given: Any, plugins: list[Path] | None, **options: Any) -> Any:
        if plugins:  # the import of the schema is slow and only needed with plugins
            from agrobot_mj.scenario.plugins import load_plugins

            load_plugins(plugins)
        return command(*given, **options)

    return with_option(begun, command, "plugins", Plugins)


def with_machine(command: Callable[..., Any]) -> Callable[..., Any]:
    """Return a command with the additional option `--machine`, or the same command if it has no option `--set`.

    The machine is applied before the overrides of `--set`.
    """
    if "sets" not in signature(command).parameters:
        return command

    @wraps(command)
    def begun(*given: Any, machine: str | None, sets: list[str] | None = None, **options: Any) -> Any:
        named = [] if machine is None else [f"machine={json.dumps(utf8(machine, '--machine'), ensure_ascii=False)}"]
        return command(*given, sets=[*named, *(sets or [])], **options)

    return with_option(begun, command, "machine", OnMachine)


def with_option(
    begun: Callable[..., Any], command: Callable[..., Any], name: str, kind: Any, default: Any = None
) -> Callable[..., Any]:
    """Give `begun`, which wraps `command`, the signature of `command` and the option `name`; return `begun`."""
    own = signature(command)
    option = Parameter(name, Parameter.KEYWORD_ONLY, default=default, annotation=kind)
    begun.__signature__ = own.replace(parameters=[*own.parameters.values(), option])  # type: ignore[attr-defined]
    begun.__annotations__ = {**command.__annotations__, name: kind}
    return begun


def names(text: str, option: str) -> list[str]:
    """Return the names in a comma-separated list, without duplicates. Raises `ScenarioError` for an empty list."""
    found = list(dict.fromkeys(name.strip() for name in text.split(",") if name.strip()))
    if not found:
        raise ScenarioError(f"{option}: the list is empty; specify at least one name")
    return found


def seconds(text: str) -> list[float]:
    """Return the times [s] in a comma-separated list. Raises `ScenarioError` unless all are finite and not negative."""
    try:
        times = [float(name) for name in names(text, "--at")]
    except ValueError:
        times = []
    if not times or not all(0 <= t < float("inf") for t in times):
        raise ScenarioError(f"--at {text}: specify comma-separated seconds, for example 5,60,120")
    return times


def results_folder(out: Path | None, default: str) -> Path:
    """Return the results folder: `out` or a folder in `runs/` named after `default`. Raises an error if the folder
    cannot be written."""
    if out is not None:
        utf8(str(out), "--out")
    folder = out if out is not None else Path("runs") / re.sub(r"[^\w.-]+", "_", default).lstrip(".")[-LONGEST_NAME:]
    if folder.exists() and not folder.is_dir():
        raise ScenarioError(f"--out {folder} is a file; specify a folder")
    if folder.is_symlink() and not folder.exists():
        raise ScenarioError(f"--out {folder}: the folder is a broken link; specify another folder")
    check_folder(folder)
    there = next(path for path in (folder, *folder.absolute().parents) if path.exists())
    try:
        tempfile.TemporaryDirectory(dir=there).cleanup()
    except OSError as error:
        raise ScenarioError(f"--out {folder}: cannot be written: {error.strerror}; specify another folder") from None
    return folder
