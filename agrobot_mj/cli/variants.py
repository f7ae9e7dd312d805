"""Texts of `--variant` to named overrides: `"worn: steering.valve.dead_band_v=0.8, path.points=[[0, 0], [9, 0]]"`."""

import tomllib
from pathlib import Path
from typing import TYPE_CHECKING, Any

from agrobot_mj.core.errors import ScenarioError

if TYPE_CHECKING:
    from agrobot_mj.studies.compare_plan import ComparedVariant

LONGEST_NAME = 60
"""Characters of a variant's name."""
CLOSING = {"[": "]", "{": "}", "(": ")"}
FORM = '"name: key=value, key=value"'


def variants(texts: list[str] | None) -> "list[ComparedVariant]":
    """The variants of the command line, in its order. Raises `ScenarioError`."""
    return [_variant(text) for text in texts or []]


def _variant(text: str) -> "ComparedVariant":
    from agrobot_mj.scenario.overrides import absolute_paths
    from agrobot_mj.studies.compare_plan import ComparedVariant

    name, colon, rest = text.partition(":")
    name = name.strip()
    if not colon or not name or "=" in name:
        raise ScenarioError(f"--variant {text!r}: write it as {FORM}")
    if len(name) > LONGEST_NAME or not name.isprintable():
        raise ScenarioError(f"--variant {name!r}: a name has at most {LONGEST_NAME} printable characters")
    found: dict[str, Any] = {}
    for item in _items(rest, name):
        key, value = _assignment(item, name)
        if key in found:
            raise ScenarioError(f"--variant {name!r}: {key} is given twice")
        given = {key.rpartition(".")[2]: value}
        absolute_paths(given, Path.cwd())
        found[key] = given.popitem()[1]
    return ComparedVariant(name, found)


def _items(text: str, name: str) -> list[str]:
    """The parts between commas that stand outside of brackets and quotes."""
    items, begun, open_brackets, quote, escaped = [], 0, [""], "", False
    for place, character in enumerate(text):
        if quote:
            if character == quote and not escaped:
                quote = ""
            escaped = quote == '"' and character == "\\" and not escaped
        elif character in "\"'":
            quote = character
        elif character in CLOSING:
            open_brackets.append(CLOSING[character])
        elif character in CLOSING.values():
            if character != open_brackets.pop() or not open_brackets:
                raise ScenarioError(f"--variant {name!r}: {text[begun:].strip()}: {character!r} closes nothing")
        elif character == "," and len(open_brackets) == 1:
            items.append(text[begun:place])
            begun = place + 1
    if quote or len(open_brackets) > 1:
        raise ScenarioError(f"--variant {name!r}: {text[begun:].strip()}: {quote or open_brackets[-1]} is missing")
    return [item for item in (*items, text[begun:]) if item.strip()]


def _assignment(item: str, name: str) -> tuple[str, Any]:
    """Key and value: TOML where it parses, else a bare word as a string."""
    key, equals, value = (part.strip() for part in item.partition("="))
    if not equals or not key or not value:
        raise ScenarioError(f"--variant {name!r}: {item.strip()!r}: write it as key=value")
    try:
        return key, tomllib.loads(f"v = {value}")["v"]
    except tomllib.TOMLDecodeError as error:
        if value[0] in "[{\"'" or not value.isprintable():
            raise ScenarioError(f"--variant {name!r}: {key}: not valid TOML: {error}") from None
        return key, value
