"""Suggestions for rejected command lines: a key for `--set`, the correct name of an option, or its command."""

import re
import sys
from typing import Any

OTHER_NAMES = {
    "law": "--guidance",
    "laws": "--guidance",
    "seeds": "--max-seeds",
    "machine": "--machines",
    "output": "--out",
    "verbose": "--help",
}
"""Options by words often used in place of their names."""
OTHER_WORDS = {"law": "guidance", "laws": "guidance"}
"""Tables by words often used in place of their names."""


def meant(error: Any) -> str:
    """Return the end of a parser error message, such as `use --set seed=3`; otherwise an empty string."""
    if (context := error.ctx) is None:
        return ""
    options = _options(context.command)
    if flag := getattr(error, "option_name", ""):
        return _for_option(flag, options, context)
    extra = re.search(r"unexpected extra argument\S* \((\S+)", error.message)
    flag = f"--{extra[1].rstrip(')')}" if extra else ""
    return f"use {flag}" if flag in options else ""


def _for_option(flag: str, options: set[str], context: Any) -> str:
    """Return the suggestion for an unknown option of a command."""
    word = flag.lstrip("-").replace("-", "_")
    if (other := OTHER_NAMES.get(word)) in options:
        return f"use {other}"
    key, value = _key(OTHER_WORDS.get(word, word)), _value(flag)
    if key and "--set" in options:
        return f"use --set {key}={value}"
    if context.command.name == "sweep" and (key or word in ("set", "seeds")):
        place = f"{word} = {value}" if word == "seeds" else f'"{key}" = {_as_toml(value)}' if key else "its keys"
        return f"add {place} to the sweep file{'' if word == 'seeds' else ', table [set]'}"
    commands = context.parent.command.commands if context.parent else {}
    having = [name for name, command in commands.items() if flag in _options(command) and not command.hidden]
    return f"{flag} is an option of {', '.join(having)}" if having else ""


def _options(command: Any) -> set[str]:
    return {name for option in command.params for name in option.opts}


def _value(flag: str) -> str:
    """Return the value of an option on the command line, or dots for an option without a plain value."""
    for word, following in zip(sys.argv, [*sys.argv[1:], ""], strict=True):
        given = following if word == flag else word.removeprefix(f"{flag}=") if word.startswith(f"{flag}=") else ""
        if re.fullmatch(r"[\w.+-]{1,40}", given) and not given.startswith("--"):
            return given
    return "..."


def _as_toml(value: str) -> str:
    return value if re.fullmatch(r"[+-]?\d[\d.e+-]*|true|false|\.\.\.", value) else f'"{value}"'


def _key(word: str) -> str:
    """Return the scenario key with this name, with or without unit, or the kind of the table with this name."""
    from agrobot_mj.core.spec import members
    from agrobot_mj.core.walk import keys
    from agrobot_mj.scenario.schema import Scenario

    found = list(keys(Scenario))
    named = [
        key.dotted
        for key in found
        if key.name == word or key.name.startswith(f"{word}_")
        if not members(key.owner.model_fields[key.name].annotation)
    ]
    tables = [f"{key.dotted}.kind" for key in found if key.name in (word, word.removesuffix("s")) and key.kinds]
    return min(tables or named, key=lambda dotted: dotted.count("."), default="")
