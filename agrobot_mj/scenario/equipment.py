"""What a scenario takes along besides path and ground, and cannot have: what was learnt, a receiver on no implement."""

import re
from collections.abc import Iterator
from typing import Any


def equipment_errors(s: Any) -> Iterator[str]:
    """Reasons why the equipment of a scenario is not there; reads the files of what was learnt in earlier runs."""
    for table, part in (("guidance", s.guidance), ("steering.loop", s.steering.loop)):
        try:
            part.check()
        except ValueError as error:
            yield prefixed(table, str(error))
    if s.sensors.implement_gnss.enabled and s.implement.kind == "none":
        yield 'sensors.implement_gnss: there is no implement to carry it; set implement.kind = "mounted" or "drawn"'


def prefixed(table: str, text: str) -> str:
    """The message of a part with the key of its table in front: a text that begins with a key goes on from there."""
    return f"{table}.{text}" if re.match(r"[a-z0-9_.\[\]]+: ", text) else f"{table}: {text}"
