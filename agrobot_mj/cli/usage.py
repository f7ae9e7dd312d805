"""Suggestions for rejected command lines: a key for `--set`, or the correct name of an option."""

import re
from typing import Any

OTHER_NAMES = {"law": "--guidance", "laws": "--guidance", "seeds": "--max-seeds"}
"""Options by words often used in place of their names."""


def meant(error: Any) -> str:
    """Return the end of a parser error message, such as `use --set seed=...`; otherwise an empty string."""
    if (context := error.ctx) is None:
        return ""
    options = {name for option in context.command.params for name in option.opts}
    if word := getattr(error, "option_name", "").lstrip("-").replace("-", "_"):
        if (other := OTHER_NAMES.get(word)) in options:
            return f"use {other}"
        return f"use --set {key}=..." if "--set" in options and (key := _key(word)) else ""
    extra = re.search(r"unexpected extra argument\S* \((\S+)", error.message)
    flag = f"--{extra[1].rstrip(')')}" if extra else ""
    return f"use {flag}" if flag in options else ""


def _key(word: str) -> str:
    """Return the scenario key with this name, with or without unit; the shortest key if several match."""
    from agrobot_mj.core.spec import members
    from agrobot_mj.core.walk import keys
    from agrobot_mj.scenario.schema import Scenario

    found = [
        key.dotted
        for key in keys(Scenario)
        if key.name == word or key.name.startswith(f"{word}_")
        if not members(key.owner.model_fields[key.name].annotation)
    ]
    return min(found, key=lambda dotted: dotted.count("."), default="")
