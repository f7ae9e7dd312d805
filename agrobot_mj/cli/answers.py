"""Printing of command results, as lines of text or, with `--json`, as one JSON document.

With `--json` stdout contains only the document, for every exit status. Progress, hints and output of libraries or
plugins go to stderr. The document contains the result of the command and the keys `command`, `version`, `exit_status`
and `error`. The value of `error` is the error message on stderr, or null.
"""

import json
import os
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, nullcontext, redirect_stdout
from functools import wraps
from inspect import signature
from typing import Annotated, Any

import typer

from agrobot_mj.cli.options import Answer, with_option
from agrobot_mj.cli.output import say
from agrobot_mj.cli.panels import command_name
from agrobot_mj.core.version import __version__

FLAG = "--json"
Json = Annotated[bool, typer.Option(FLAG, help="Print one JSON document, also on failure.")]


def with_json(command: Callable[..., Any]) -> Callable[..., Any]:
    """Return a command with the additional option `--json`, or the same command if its result is not an `Answer`."""
    if signature(command).return_annotation is not Answer:
        return command

    @wraps(command)
    def begun(*given: Any, as_json: bool, **options: Any) -> None:
        with _stdout_to_stderr() if as_json else nullcontext():
            answer: Answer = command(*given, **options)
        if as_json:
            say(document(command_name(command), int(bool(answer.failed)), answer.failed, answer.content))
        elif answer.text and not options.get("quiet"):
            say(answer.text)
        if answer.failed:
            print(answer.failed, file=sys.stderr)
            raise typer.Exit(1)

    return with_option(begun, command, "as_json", Json, False)


def document(command: str, status: int, error: str, content: Mapping[str, Any]) -> str:
    """Return the text of the JSON document with the result `content`, the exit status and the error of a command."""
    about = {"command": command, "version": __version__, "exit_status": status, "error": error or None}
    return json.dumps({**about, **content}, indent=2, allow_nan=False)


@contextmanager
def _stdout_to_stderr() -> Iterator[None]:
    sys.stdout.flush()
    kept = os.dup(1)
    os.dup2(2, 1)
    try:
        with redirect_stdout(sys.stderr):
            yield
    finally:
        os.dup2(kept, 1)
        os.close(kept)
