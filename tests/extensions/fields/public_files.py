"""Test the import of files from public repositories: python tests/extensions/fields/public_files.py FOLDER

`public_files.csv` lists recorded paths, plans and boundaries: repository, commit, path, kind, extent to the east and
north [m], and length [m] of a path or area [ha] of a field. These values come from the columns, units and description
of each file, not from the importer. A file of kind `none` has no usable positions; its error message must contain the
text in the column `reason`. The CSV file contains no content of these files.

FOLDER contains the repositories as OWNER+NAME, cloned or as git directories. Missing repositories are cloned, or
skipped without a connection. The exit status is 1 if more than 3 % of the files are read or rejected wrongly.
"""

import csv
import subprocess
import sys
from collections import Counter
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.core.resources import stamp_of
from agrobot_mj.extensions.fields.reading import read_field
from agrobot_mj.paths.waypoints import MAX_BYTES, track

EXPECTED = Path(__file__).with_suffix(".csv")
NEAR, NEAR_M = 0.01, 0.1  # Tolerance of extent and area, divided by the value [-], and of an extent [m]
NEAR_LENGTH = 0.05  # Tolerance of a length, divided by the value [-]
THINNED, THINNED_M = 0.15, 0.8  # Tolerance of length [-] and extent [m] of a noisy track that is thinned
MOST_WRONG = 0.03  # Maximum fraction of files that are read or rejected wrongly [-]


def git(folder: Path, *arguments: str) -> bytes:
    """Return the output of a git command in a repository, or no bytes if git fails."""
    places = (folder, folder / ".git", folder / "repo", folder / "repo" / ".git")
    place = next((each for each in reversed(places) if (each / "objects").is_dir()), folder)
    return subprocess.run(["git", f"--git-dir={place}", *arguments], check=False, capture_output=True).stdout


def copied(repository: str, commit: str, path: str, folder: Path, to: Path) -> Path | None:
    """Copy a file and its companion files to the folder `to`. Return the path of the file, or None if the file is not
    available."""
    source = folder / repository.replace("/", "+")
    if not source.is_dir():
        address = f"https://github.com/{repository}"
        subprocess.run(["git", "clone", "-q", "--bare", "--filter=blob:none", address, str(source)], check=False)
    parent = str(Path(path).parent)
    names = git(source, "ls-tree", "--name-only", commit, *([] if parent == "." else [f"{parent}/"])).decode()
    for name in names.splitlines():
        if Path(name).stem == Path(path).stem or name.upper().endswith((".XML", "FIELD.TXT")):
            (to / Path(name).name).write_bytes(git(source, "show", f"{commit}:{name}"))
    file = to / Path(path).name
    return file if file.is_file() else None


def found(file: Path, kind: str) -> tuple[tuple[float, ...], bool]:
    """Return extents to the east and north [m], area [ha] or length [m], and whether the importer thinned the track."""
    if kind == "field" or file.suffix.lower() in (".shp", ".xml"):
        boundary = read_field(file).boundary
        west, south, east, north = boundary.bounds
        return (east - west, north - south, boundary.area / 1e4), False
    points, notes = track(stamp_of(str(file), (), MAX_BYTES), "", False)
    points, thinned = points[:, :2], any("reduced from" in note for note in notes)
    return (*np.ptp(points, axis=0).tolist(), float(np.hypot(*np.diff(points, axis=0).T).sum())), thinned


def verdict(file: Path, row: dict[str, str]) -> tuple[str, str]:
    """Return `read`, `rejected`, `wrong` or `wrongly rejected`, and the values or the message."""
    try:
        values, thinned = found(file, row["kind"])
    except (ScenarioError, ValueError) as error:
        text = str(error).partition(": ")[2]  # without the name of the file
        return "rejected" if row["kind"] == "none" and row["reason"] in text else "wrongly rejected", text
    except Exception as error:  # a traceback for the user
        return "wrong", f"{type(error).__name__}: {error}"
    near_size = NEAR if row["kind"] == "field" else THINNED if thinned else NEAR_LENGTH
    slack = THINNED_M if thinned else NEAR_M
    near = row["kind"] != "none" and all(
        abs(value - float(row[key])) <= limit * float(row[key]) + more
        for value, key, limit, more in zip(
            values, ("east_m", "north_m", "size"), (NEAR, NEAR, near_size), (slack, slack, 0.001), strict=True
        )
    )
    return "read" if near else "wrong", f"{values[0]:.1f} x {values[1]:.1f} m, {values[2]:.4g}"


def main() -> None:
    folder, counts = Path(sys.argv[1]), Counter[str]()
    for row in csv.DictReader(EXPECTED.open(encoding="utf-8")):
        with TemporaryDirectory() as place:
            file = copied(row["repository"], row["commit"], row["path"], folder, Path(place))
            said, text = verdict(file, row) if file else ("skipped", "not available")
        counts[said] += 1
        print(f"{said:17}{row['repository']} {row['path']}: {text}")
    total = sum(counts.values()) - counts["skipped"]
    wrong = counts["wrong"] + counts["wrongly rejected"]
    print(f"{total} files: " + ", ".join(f"{count} {said}" for said, count in counts.items()))
    raise SystemExit(not total or wrong > MOST_WRONG * total)


if __name__ == "__main__":
    main()
