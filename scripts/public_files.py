"""Import of public field files: python scripts/public_files.py [FOLDER ...]

Downloads the source packages in `EXPECTED` from PyPI into runs/public and reads their boundaries. Prints whether each
file is read, refused with the right reason, or wrong; the exit status is 1 if a file is wrong. Files of other folders,
such as cloned repositories, are read too; their areas and messages are for inspection.
"""

import os
import subprocess
import sys
import tarfile
from collections.abc import Iterator
from pathlib import Path

from provenance import ROOT

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.extensions.fields.reading import read_field

FOLDER = ROOT / "runs" / "public"
EXPECTED: dict[str, dict[str, float | str]] = {
    "fields2cover": {
        **dict.fromkeys(("Envelope.xml", "envelope1.xml", "test1.xml"), 17.26),
        **{"ee_field_130.wkt": 1.963, "test.json": 3.596, "test_2_cell.json": 24.00, "strips.geojson": 0.081},
        **{"swaths.geojson": "has 2 points", "test_ring.json": "more than 100 km"},
    }
}
"""Area [ha] or part of the message for each file of a package."""
SUFFIXES = (".json", ".geojson", ".kml", ".gpx", ".gml", ".xml", ".wkt", ".csv", ".shp", ".zip")
NEAR = 1e-3  # Tolerance of an area [-]


def source_files(package: str, folder: Path) -> list[Path]:
    """Return the files in `data/` of a source package on PyPI, or an empty list if the package is not available."""
    if not (found := list(folder.glob(f"{package}-*.tar.gz"))):
        pip, tools = [sys.executable, "-m", "pip", "-q"], folder / "tools"
        source = ("--no-deps", "--no-binary", ":all:", "--no-build-isolation", "--dest", str(folder), package)
        for command in (["install", "--target", str(tools), "scikit-build-core"], ["download", *source]):
            subprocess.run([*pip, *command], env={**os.environ, "PYTHONPATH": str(tools)}, check=False)
        if not (found := list(folder.glob(f"{package}-*.tar.gz"))):
            return []
    with tarfile.open(found[0]) as archive:
        members = [each for each in archive.getmembers() if "/data/" in each.name]
        archive.extractall(folder, members, filter="data")
    return [folder / each.name for each in members if each.isfile()]


def verdict(file: Path, expected: float | str | None) -> tuple[str, str]:
    """Return `read`, `refused` or `wrong`, and the area or the message."""
    try:
        area = read_field(file).boundary.area / 1e4
    except ScenarioError as error:
        right = expected is None or (isinstance(expected, str) and expected in str(error))
        return "refused" if right else "wrong", str(error)
    except Exception as error:  # a traceback for the user
        return "wrong", f"{type(error).__name__}: {error}"
    right = expected is None or (not isinstance(expected, str) and abs(area / expected - 1) < NEAR + 0.005 / expected)
    return "read" if right else "wrong", f"{area:.3f} ha"


def verdicts(folders: list[str]) -> Iterator[tuple[Path, str, str]]:
    for package, expected in EXPECTED.items():
        for file in source_files(package, FOLDER):
            if file.name in expected:
                yield file, *verdict(file, expected[file.name])
    for folder in folders:
        for file in sorted(Path(folder).rglob("*")):
            if file.suffix.lower() in SUFFIXES:
                yield file, *verdict(file, None)


def main() -> None:
    found = list(verdicts(sys.argv[1:]))
    for file, said, text in found:
        print(f"{said:8}{file.name}: {text.removeprefix(f'{file.name}: ')}")
    counts = {said: sum(each[1] == said for each in found) for said in ("read", "refused", "wrong")}
    print(f"{len(found)} files: " + ", ".join(f"{count} {said}" for said, count in counts.items()))
    raise SystemExit(bool(counts["wrong"]))


if __name__ == "__main__":
    main()
