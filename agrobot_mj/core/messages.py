"""Conversion of pydantic validation errors to one message per file, which lists each error with its key and the fix."""

import re
from collections.abc import Mapping
from typing import Any

from pydantic import ValidationError

from agrobot_mj.core.errors import MOST_FAULTS, PLUGIN, shorten, suggestion
from agrobot_mj.core.spec import Spec, members
from agrobot_mj.core.walk import elsewhere, nearest

_TEXTS = {
    "greater_than": "must be above {gt:g}, got {input}",
    "greater_than_equal": "must be at least {ge:g}, got {input}",
    "less_than": "must be below {lt:g}, got {input}",
    "less_than_equal": "must be at most {le:g}, got {input}",
    "finite_number": "must be a finite number, got {input}",
    "float_type": "must be a number, got {input!r}",
    "float_parsing": "must be a number, got {input!r}",
    "int_type": "must be a whole number, got {input!r}",
    "int_parsing": "must be a whole number, got {input!r}",
    "int_from_float": "must be a whole number, got {input}",
    "string_type": "must be a string, got {input!r}",
    "bool_type": "must be true or false, got {input!r}",
    "list_type": "must be a list, got {input!r}",
    "tuple_type": "must be a list, got {input!r}",
    "literal_error": "must be one of {expected}, got {input!r}",
    "model_type": "must be a table, got {input!r}",
    "dict_type": "must be a table, got {input!r}",
    "missing": "is missing",
    "too_long": "must have at most {max_length} items",
    "too_short": "must have at least {min_length} items, got {actual_length}",
}


def explain(error: ValidationError, source: str, data: Mapping[str, Any], root: type[Spec]) -> str:
    """Return a message with one line `source: key: error and fix` per error, and the number of omitted errors."""
    errors, more = first_faults(error)
    texts = [_line(each, data, root) for each in errors]
    lines = [f"{source}: {line}" for text in texts for line in text.split("\n")]
    return "\n".join([*dict.fromkeys(lines), *(f"{source}: {text}" for text in more)])


def first_faults(error: ValidationError) -> tuple[list[dict[str, Any]], list[str]]:
    """Return the first `MOST_FAULTS` errors of pydantic and, for further errors, a line with their number."""
    left = error.error_count() - MOST_FAULTS
    errors = [dict(each) for each in error.errors(include_url=False)[:MOST_FAULTS]]
    return errors, [f"and {left:,} more errors"] if left > 0 else []


def _line(error: dict[str, Any], data: Mapping[str, Any], root: type[Spec]) -> str:
    keys, owner = _walk(error["loc"], data, root)
    kind, context = str(error["type"]), error.get("ctx", {})
    if kind == "extra_forbidden":
        known = sorted(owner.model_fields) if owner else []
        near = nearest(root, re.sub(r"\[\d+\]", "", ".".join(keys)), owner) or suggestion(keys[-1], known)
        text = f"unknown key{near} (known: {', '.join(known)})"
    elif kind == "union_tag_not_found":
        field = owner.model_fields.get(keys[-1].partition("[")[0]) if owner else None
        keys, text = [*keys, "kind"], f"is missing (known: {', '.join(members(field.annotation) if field else ())})"
    elif kind == "union_tag_invalid":
        keys = [*keys, "kind"]
        tag, expected = shorten(str(context.get("tag", ""))), str(context.get("expected_tags", ""))
        known = re.findall(r"'([^']+)'", expected)
        text = f"unknown kind {tag!r}{suggestion(tag, known)} (known: {', '.join(known)}); {PLUGIN}"
    elif kind == "string_type" and isinstance(error["input"], Mapping):
        text = fault(error) + elsewhere(root, str(next(iter(error["input"]), "")))
    elif kind == "tuple_type" and isinstance(error["input"], Mapping):
        text = f"must be a list of tables; write [[{'.'.join(keys)}]]"
    else:
        text = fault(error)
        if kind == "value_error" and keys and re.match(r"[a-z0-9_.]+: ", text):
            return ".".join(keys) + "." + text
    return f"{'.'.join(keys)}: {text}" if keys else text


def fault(error: Mapping[str, Any]) -> str:
    """Return the message text for one pydantic error, without the key."""
    template = _TEXTS.get(str(error["type"]))
    if template is None:
        return str(error["msg"]).removeprefix("Value error, ")
    return template.format(**{**error.get("ctx", {}), "input": _Repeated(error["input"])})


class _Repeated:
    """Invalid input value quoted in a message, shortened to about `LONGEST_VALUE` characters."""

    def __init__(self, value: Any) -> None:
        self.value = value

    def __str__(self) -> str:
        return shorten(str(self.value))

    def __repr__(self) -> str:
        return shorten(repr(self.value))


def _walk(loc: tuple[Any, ...], data: Any, root: type[Spec]) -> tuple[list[str], type[Spec] | None]:
    """Return the keys in the location of a pydantic error, without union tags, and the class of the last key or
    None."""
    keys: list[str] = []
    owner: type[Spec] | None = root
    following: type[Spec] | None = root
    tags: Mapping[str, type[Spec]] = {}
    for step in loc:
        if isinstance(step, int):
            keys[-1] += f"[{step}]"
            data = data[step] if isinstance(data, list) and step < len(data) else None
            continue
        if step in tags and isinstance(data, Mapping) and data.get("kind") == step:
            following, tags = tags[step], {}
            continue
        if keys and data is not None and not isinstance(data, Mapping | list):
            continue  # name of a branch in a union of plain values, not a key
        owner = following
        keys.append(shorten(str(step)))
        data = data.get(step) if isinstance(data, Mapping) else None
        tags = members(owner.model_fields[step].annotation) if owner and step in owner.model_fields else {}
        following = next(iter(tags.values())) if len(tags) == 1 else None
    return keys, owner
