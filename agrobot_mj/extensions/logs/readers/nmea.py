"""Reader for NMEA 0183 sentences of a receiver or board, in a text file or among other bytes.

Sentences may follow the time stamp of a logger, or be inside JSON or between binary messages of the receiver. Times are
receiver times. A sentence without a time gets the time of the preceding sentence. Sentences before the first fix are
omitted, because the receiver has not yet set its clock. In GGA sentences without a quality, the status of RMC sentences
determines whether there is a fix. The speed is over ground, and positive also in reverse.
"""

import mmap
from math import inf, isnan
from pathlib import Path
from typing import Any, Literal

from agrobot_mj.core.errors import shorten
from agrobot_mj.core.nmea import NO_FIX, fields_of
from agrobot_mj.core.table_columns import FieldLogError, check_size
from agrobot_mj.extensions.logs.readers.base import DAY_S, DayClock, Head, LogReader, ReadLog, Samples
from agrobot_mj.extensions.logs.readers.sentences import KINDS, SENTENCE, Quantities, Sentence, found_in

RESET_S = 60.0
"""Minimum time jump that indicates a reset of the clock of a receiver without a fix [s]."""


class NmeaText(LogReader):
    """Reader for NMEA sentences: position with quality, speed, course, and heading if available."""

    kind: Literal["nmea"] = "nmea"

    def recognises(self, head: Head) -> bool:
        """Return whether the start of a file contains a sentence with a valid checksum."""
        return any(fields_of(match[0]) for match in SENTENCE.finditer(head.data))

    def read(self, path: Path) -> ReadLog:
        """Return the values of all supported sentences. Sentences with an invalid checksum are omitted and counted."""
        check_size(path)
        with path.open("rb") as stream, mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as data:
            return _Sentences(path, data).read()


class _Sentences:
    """Converter for the NMEA sentences in one file, with the clock of the receiver."""

    def __init__(self, path: Path, data: mmap.mmap) -> None:
        self.data, self.name, self.samples = data, path.name, Samples(path)
        self.clock, self.t = DayClock(), -inf
        self.early, self.kept, self.unclear, self.first_unclear = 0, 0, 0, ""
        self.valid, self.invalid = set[str](), dict[str, Any]()
        """Types of sentences with a valid checksum. For each type, the number of sentences without a valid checksum,
        and the line number and text of the first such sentence."""
        self._counted, self._line = 0, 1
        self._void = data.find(b"RMC,") >= 0  # whether the latest RMC sentence reports no fix, or has yet to come

    def read(self) -> ReadLog:
        """Return the values of all sentences. Raises `FieldLogError` if no sentence has a fix, or if too many sentences
        are invalid."""
        for found in found_in(self.data):
            if not found.fields:
                count, *first = self.invalid.get(found.kind) or (0, self._line_of(found), found.text)
                self.invalid[found.kind] = (count + 1, *first)
                continue
            self.valid.add(found.kind)
            if (values := self._values(found)) is not None:
                self.samples.add(self.t, found.kind, **values)
                self.kept += 1
        if self.early and not self.kept:
            raise FieldLogError(f"{self.name}: none of the {self.early} sentences has a fix; record a log with a fix")
        notes = []
        if self.early:
            notes.append(f"{self.early} sentences without a valid fix or time at the start are omitted")
        if self.unclear:
            notes.append(f"{self.unclear} sentences with invalid fields are omitted (first: {self.first_unclear})")
        for kind, (count, line, text) in self.invalid.items():
            why = "wrong checksum" if "*" in text else "no checksum"
            if self.valid and kind not in self.valid:
                notes.append(f"all {count} {kind} sentences are omitted: {why}")
                continue
            for _ in range(count):
                self.samples.count_damaged(line, f"{why}: {text}")
        what = f"sentences with a time, a fix and values ({', '.join(KINDS)})"
        return self.samples.log(what, *notes, speed={"of": "antenna"})

    def _values(self, found: Sentence) -> Quantities | None:
        """Set the clock to the time of a sentence, and return the quantities in the sentence. Return None for an
        invalid sentence, or before the first fix."""
        kind = KINDS[found.kind]
        try:
            values = kind.quantities(found.fields)
            if found.kind == "RMC":
                self._void = "latitude" not in values
            elif self._void and isnan(values.get("quality", 0.0)):  # GGA without a quality: RMC reports the fix
                values = {"quality": NO_FIX}
            if self.t == -inf and "latitude" not in values:
                self.early += 1
                return None
            if kind.time and (text := found.fields[kind.time]):
                text = text[8:] if found.kind == "KSXT" else text  # the time of KSXT includes the date
                if "latitude" not in values and self._is_reset(text):
                    return None
                self.t = self.clock.at(text)
        except (ValueError, IndexError):
            self.unclear += 1
            self.first_unclear = self.first_unclear or f"line {self._line_of(found)}, {shorten(found.text, 60)}"
            return None
        return values

    def _is_reset(self, text: str) -> bool:
        """Return whether a time of day differs from the time of the preceding sentence by more than `RESET_S`."""
        apart = (DayClock().at(text) - self.clock.last + DAY_S / 2) % DAY_S - DAY_S / 2
        return abs(apart) > RESET_S

    def _line_of(self, found: Sentence) -> int:
        """Return the line number of a sentence. The search starts at the line found by the previous call."""
        self._line += self.data[self._counted : found.at].count(b"\n")
        self._counted = found.at
        return self._line
