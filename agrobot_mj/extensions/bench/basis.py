"""Basis of the parameters of a machine: measured, printed, identified or assumed.

A key of the machine file has the basis that its comment begins with, or that of the comment above if it
has none. A key that the file does not set has the basis of its docstring; one that follows from the size is assumed.
"""

import re
from collections.abc import Iterator
from typing import NamedTuple

from agrobot_mj.core.spec import Spec
from agrobot_mj.scenario import Scenario
from agrobot_mj.scenario.machines import machine_file

SAYS = {
    "measured": r"(Log|Measured)\b",
    "identified": r"Identified\b",
    "assumed": r"(Estimate|Assumed)\b|.*\bAssumed value\b",
    "printed": r"(Maker|Print|Printed|Code|Paper)\b|\[[A-Z][A-Za-z]+\d{4}",
}
"""Beginnings of a comment, by basis."""
CITED = re.compile(r"\[[A-Z][A-Za-z]+\d{4}|Paper,")
UNKNOWN = "not stated"
"""Basis of a number without a comment in a file."""
_TABLE, _KEY = re.compile(r"\s*\[([\w.]+)\]\s*(?:#\s*(.*))?$"), re.compile(r"\s*([\w.]+)\s*=[^#]*(?:#\s*(.*))?$")


class Basis(NamedTuple):
    """Parameter with its basis."""

    key: str
    value: float
    """Value in the unit of the key."""
    basis: str
    """One of `SAYS`, or `UNKNOWN`."""


def bases(machine: str, scenario: Scenario) -> Iterator[Basis]:
    """Yield every number of tractor, steering and driveline of a machine, by name or path, with its basis."""
    found = machine_file(machine)
    stated = {} if found is None else comments(found[0].read_text(encoding="utf-8"))
    for table, part in (
        ("tractor", scenario.tractor),
        ("steering.valve", scenario.steering.valve),
        ("steering.cylinder", scenario.steering.cylinder),
        ("steering.linkage", scenario.steering.linkage),
        ("driveline", scenario.driveline),
    ):
        for name in type(part).model_fields:
            value = getattr(part, name)
            if isinstance(value, int | float) and not isinstance(value, bool):
                key = f"{table}.{name}"
                yield Basis(key, float(value), stated.get(key) or of_default(part, name))


def comments(text: str) -> dict[str, str]:
    """Return the basis of each dotted key of a machine file, by its comments."""
    table, last, found = "", UNKNOWN, dict[str, str]()
    for line in text.splitlines():
        if header := _TABLE.match(line):
            table, last = header[1], basis_of(header[2] or "")
        elif key := _KEY.match(line):
            last = basis_of(key[2]) if key[2] else last
            found[f"{table}.{key[1]}" if table else key[1]] = last
    return found


def basis_of(comment: str) -> str:
    """Return the basis that a comment begins with."""
    return next((basis for basis, pattern in SAYS.items() if re.match(pattern, comment)), UNKNOWN)


def of_default(part: Spec, name: str) -> str:
    """Return the basis of a number that no file sets, by the docstring of its key."""
    text = type(part).describe(name)
    if "Assumed value" in text or name in part.sized:
        return "assumed"
    return "printed" if CITED.search(text) else "assumed"


def basis_text(found: Basis) -> str:
    """Return a parameter as a line of text."""
    return f"{found.key:40} {float(f'{found.value:.4g}'):9g} {found.basis}"
