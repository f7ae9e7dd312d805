"""Command line, based on typer. Each command loads its input, calls one function and prints the result.

Exit status:

- 0: the run ended as its scenario expects.
- 1: the run ended with another outcome, or files could not be written.
- 2: the input is invalid; one message reports the error, without a traceback.
- 130: Ctrl-C or SIGTERM interrupted the command.

With `--json`, stdout contains one JSON document for every status (see `answers`). Commands import large libraries only
when called, so that `--help` and `list` start fast.
"""

import atexit
import errno
import gc
import io
import os
import re
import sys
import traceback
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from agrobot_mj.cli.answers import FLAG, document
from agrobot_mj.cli.app import app
from agrobot_mj.cli.interrupts import interruptible
from agrobot_mj.cli.options import overrides
from agrobot_mj.cli.output import say
from agrobot_mj.cli.panels import split_command
from agrobot_mj.core.errors import ScenarioError, missing_extra, shorten_lines

if TYPE_CHECKING:
    from agrobot_mj.core.walk import Key

__all__ = ["app", "main"]


BROKEN_OFF = 130  # Exit status after an interruption by a signal, as used by Unix shells
OBJECTS_PER_COLLECTION = 500_000
"""Number of new objects between two garbage collections [-]. Python's default increases the start-up time by 0.25 s."""
NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO)
"""Error numbers (errno) of a full or faulty disk, for which the exit status is 1 instead of 2 (invalid input)."""
USAGE_ERROR: Any = typer.BadParameter.__bases__[0]
"""Base class of usage errors of the command-line parser, from click or from the copy of click in typer."""


def main() -> None:
    """Run the command line. For invalid input, exit with status 2 and one message, or a JSON document with `--json`."""
    gc.set_threshold(OBJECTS_PER_COLLECTION)
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # threads for small matrices only wait for each other
    atexit.register(gc.freeze)  # avoids a garbage collection over all modules at exit, which takes 0.4 s
    sys.stdout = sys.stdout or Path(os.devnull).open("w")  # noqa: SIM115 - closed by the caller
    sys.stderr = sys.stderr or Path(os.devnull).open("w")  # noqa: SIM115
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # terminals show characters outside their encoding as escape sequences
            stream.reconfigure(errors="backslashreplace")
    try:
        status, message = _exit_status_and_message()
    except ScenarioError as error:
        status, message = 2, str(error)
    except ModuleNotFoundError as error:
        status, message = 2, missing_extra(error)
        if not message:
            raise
    except OSError as error:
        place = f"{error.filename}: " if error.filename else ""
        status, message = 1 if error.errno in NO_ROOM else 2, f"{place}{error.strerror or error}"
    except Exception as error:
        status, message = 1, _of_plugin(error)
        if not message:
            raise
    if message := shorten_lines(message):
        print(message, file=sys.stderr)
        if FLAG in sys.argv:
            say(document(split_command(sys.argv[1:])[0], status, message, {}))
    raise SystemExit(_flush_stdout(status))


def _of_plugin(error: Exception) -> str:
    """Return the traceback of `error`, or of its cause, from the first frame in a plugin file; "" if there is none."""
    if (plugins := sys.modules.get("agrobot_mj.scenario.plugins")) is None:
        return ""
    files, frame = set(map(str, plugins.loaded_files())), error.__traceback__
    while frame is not None and frame.tb_frame.f_code.co_filename not in files:
        frame = frame.tb_next
    if frame:
        return "".join(traceback.format_exception(type(error), error, frame)).rstrip()
    # Python converts StopIteration within a generator to RuntimeError
    return _of_plugin(error.__cause__) if isinstance(error.__cause__, Exception) else ""


def _exit_status_and_message() -> tuple[int, str]:
    try:
        Path.cwd()
    except FileNotFoundError:
        return 2, "the working directory no longer exists; change to another one"
    status: Any
    try:
        with interruptible():
            status = app(standalone_mode=False)
    except USAGE_ERROR as error:  # for example an unknown option
        if hint := suggest_option(error):
            error.possibilities = None  # suggestions of merely similar options
            error.message += f"; {hint}"
        if (parameter := getattr(error, "param", None)) and not error.message:  # a missing argument or option
            error.message = parameter.help or ""
            if parameter.metavar and (name := parameter.opts[0]).startswith("-"):
                error.param_hint = repr(f"{name} {parameter.metavar}")
        if invalid := getattr(error.__cause__, "errors", None):  # a pydantic.ValidationError
            from agrobot_mj.core.messages import fault

            error.message = "; ".join(fault(each) for each in invalid())
        error.show(shown := io.StringIO())
        return 2, shown.getvalue().rstrip("\n")
    except SystemExit as leaving:
        status = leaving.code
    except (KeyboardInterrupt, typer.Abort):
        status = BROKEN_OFF
    status = status if isinstance(status, int) else int(status is not None)
    return status, "interrupted before the end" if status == BROKEN_OFF else ""


def _flush_stdout(status: int) -> int:
    """Flush stdout and return `status`. A closed pipe or a full disk does not change the exit status."""
    try:
        sys.stdout.flush()
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # avoids a second error at interpreter exit
    return status


OTHER_NAMES = {
    "law": "--guidance",
    "laws": "--guidance",
    "seeds": "--max-seeds",
    "machine": "--machines",
    "output": "--out",
    "verbose": "--help",
}
"""Command-line options, keyed by words that users often type instead."""
OTHER_WORDS = {"law": "guidance", "laws": "guidance"}
"""Scenario tables, keyed by words that users often type instead."""


def suggest_option(error: Any) -> str:
    """Return a suggestion that ends the message of a usage error, such as `use --set seed=3`, or an empty string.

    If the suggested key does not accept the value on the command line, a second line states the reason.
    """
    if (context := error.ctx) is None:
        return ""
    options = _options(context.command)
    if flag := getattr(error, "option_name", ""):
        return _for_option(flag, options, context)
    extra = re.search(r"unexpected extra argument\S* \((\S+)", error.message)
    flag = f"--{extra[1].rstrip(')')}" if extra else ""
    return f"use {flag}" if flag in options else ""


def _for_option(flag: str, options: set[str], context: Any) -> str:
    """Return the suggestion for the unknown option `flag`, or an empty string if there is none."""
    word = flag.lstrip("-").replace("-", "_")
    if (other := OTHER_NAMES.get(word)) in options:
        return f"use {other}"
    key, value, reason = _key(OTHER_WORDS.get(word, word)), _value(flag), ""
    if key and value != "..." and (rejection := _rejection(key, value)):
        value, reason = "...", f"\n{rejection}"
    if key and "--set" in options:
        return f"use --set {key.dotted}={value}{reason}"
    if context.command.name == "sweep" and (key or word in ("set", "seeds")):
        count = value if value.isdecimal() else "..."
        place = f"seeds = {count}" if word == "seeds" else f'"{key.dotted}" = {_as_toml(value)}' if key else "its keys"
        return f"add {place} to the sweep file{'' if word == 'seeds' else ', table [set]'}{reason}"
    commands = context.parent.command.commands if context.parent else {}
    having = [name for name, command in commands.items() if flag in _options(command)]
    return f"{flag} is an option of {', '.join(having)}" if having else ""


def _options(command: Any) -> set[str]:
    return {name for option in command.params for name in option.opts}


def _value(flag: str) -> str:
    """Return the value of the option `flag` on the command line, or "..." if the value is missing or needs quotes."""
    for word, following in zip(sys.argv, [*sys.argv[1:], ""], strict=True):
        given = following if word == flag else word.removeprefix(f"{flag}=") if word.startswith(f"{flag}=") else ""
        if re.fullmatch(r"[\w.+-]{1,40}", given) and not given.startswith("--"):
            return given
    return "..."


def _as_toml(value: str) -> str:
    return value if re.fullmatch(r"[+-]?\d[\d.e+-]*|true|false|\.\.\.", value) else f'"{value}"'


def _key(word: str) -> "Key | None":
    """Return the scenario key `word`, with or without unit, or the key `kind` of the table `word`; None if neither
    exists."""
    from agrobot_mj.core.spec import members
    from agrobot_mj.core.walk import keys
    from agrobot_mj.scenario.schema import Scenario

    found = list(keys(Scenario))
    named = [
        key
        for key in found
        if key.name == word or key.name.startswith(f"{word}_")
        if not members(key.owner.model_fields[key.name].annotation)
    ]
    tables = [
        key._replace(dotted=f"{key.dotted}.kind", name=f"{key.name}.kind")
        for key in found
        if key.name in (word, word.removesuffix("s")) and key.kinds
        if not isinstance(key.owner.model_fields[key.name].default, tuple)  # a list of tables, such as `fault`
    ]
    return min(tables or named, key=lambda key: key.dotted.count("."), default=None)


def _rejection(key: "Key", value: str) -> str:
    """Return the reason why a key does not accept a value on the command line, or an empty string."""
    from agrobot_mj.scenario.overrides import read_spec

    table, dot, kind = key.name.partition(".")
    given = overrides([f"{kind or table}={value}"])
    try:
        read_spec(key.owner, {table: given} if dot else given, "")
    except ScenarioError as error:
        start = f": {key.name}: "
        lines = [line.removeprefix(start) for line in str(error).splitlines() if line.startswith(start)]
        return f"{key.dotted}: {lines[0]}" if lines else ""
    return ""
