"""Texts of `--variant` to named overrides: `"worn: steering.valve.dead_band_v=0.8, path.points=[[0, 0], [9, 0]]"`."""

import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from agrobot_mj.core.errors import ScenarioError

if TYPE_CHECKING:
    from agrobot_mj.studies.compare_plan import ComparedVariant

LONGEST_NAME = 60
"""Characters of a variant's name."""
BRACKETS = set("[]{}\"'")
"""Characters that are no part of a bare word."""
FORM = '"name: key=value, key=value"'


def variants(texts: list[str] | None) -> "list[ComparedVariant]":
    """The variants of the command line, in its order. Raises `ScenarioError`."""
    return [_variant(text) for text in texts or []]


def _variant(text: str) -> "ComparedVariant":
    from agrobot_mj.scenario.overrides import absolute_value
    from agrobot_mj.studies.compare_plan import ComparedVariant

    name, colon, rest = text.partition(":")
    name = name.strip()
    if not colon or not name or "=" in name:
        raise ScenarioError(f"--variant {text!r}: write it as {FORM}")
    if len(name) > LONGEST_NAME or not name.isprintable():
        raise ScenarioError(f"--variant {name!r}: a name has at most {LONGEST_NAME} printable characters")
    found: dict[str, Any] = {}
    for key, value in _items(rest, name):
        if key in found:
            raise ScenarioError(f"--variant {name!r}: {key} is given twice")
        found[key] = absolute_value(key, value, Path.cwd())
    return ComparedVariant(name, found)


def _items(text: str, name: str) -> Iterator[tuple[str, Any]]:
    """Keys and values of `KEY=VALUE, ...`; a value is TOML, which may hold commas, or else a bare word."""
    item, fault = "", ""
    for part in text.split(","):
        item += part
        key, equals, value = (piece.strip() for piece in item.partition("="))
        if not item.strip():
            continue
        if not equals or not key or not value:
            raise ScenarioError(f"--variant {name!r}: {item.strip()!r}: write it as key=value")
        try:
            yield key, tomllib.loads(f"v = {value}")["v"]
        except tomllib.TOMLDecodeError as error:
            if BRACKETS & set(value) or not value.isprintable():
                item, fault = f"{item},", f"--variant {name!r}: {key}: not valid TOML: {error}"
                continue
            yield key, value
        item = ""
    if item.strip():
        raise ScenarioError(fault)
