"""Sources of fields and plans: files, folders of AgOpenGPS or ISO 11783 task data, and zip archives."""

import zipfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from xml.etree import ElementTree

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.core.resources import ZIP_ERRORS, absence, refuse
from agrobot_mj.extensions.fields.formats import READERS
from agrobot_mj.extensions.fields.formats.isoxml import read_task_data
from agrobot_mj.paths.imports import ShapeFile, read_shapes
from agrobot_mj.paths.imports.agopengps import is_folder_of_field, read_origin
from agrobot_mj.paths.imports.reading import MAX_BYTES, decode
from agrobot_mj.paths.imports.xml_files import parsed_xml

TASKDATA = "TASKDATA.XML"
MOST_UNPACKED_BYTES, MOST_MEMBERS = 300_000_000, 5_000
"""Maximum unpacked size [bytes] and maximum number of files of a zip archive."""
PREFERRED = (".shp", ".geojson", ".kml", ".gml", ".gpx", ".json", ".wkt", ".csv")
"""File extensions in order of preference, for folders and archives without files of AgOpenGPS or ISO 11783."""
BOUNDARIES, PLANS = ("Boundary.txt", "Headland.txt"), ("RecPath.txt", "TrackLines.txt")
"""AgOpenGPS files of a field boundary, all of which are read, and AgOpenGPS files of a plan, in order of preference."""
ELEVATION, HEAD_CHARACTERS = "Elevation.txt", 2000
"""AgOpenGPS file of recorded heights, and number of characters that are read to find its first point."""


def field_shapes(path: Path) -> ShapeFile:
    """Return the shapes of a field from a file, folder or zip archive. Raise `ScenarioError` for an unusable source."""
    return _shapes(path, _boundaries)


def plan_shapes(path: Path) -> ShapeFile:
    """Return the shapes of a plan from a file, folder or zip archive. Raise `ScenarioError` for an unusable source."""
    return _shapes(path, _tracks)


def elevation_file(path: Path) -> Path | None:
    """Return the `Elevation.txt` of the AgOpenGPS field at `path`, or None if it is missing or contains no points."""
    folder = next(iter(_sources_in(path)), path) if path.is_dir() else path.parent
    file = folder / ELEVATION
    if not (path.is_dir() or path.suffix.lower() == ".txt") or not is_folder_of_field(folder) or not file.is_file():
        return None
    try:
        with file.open(encoding="utf-8-sig", errors="replace") as stream:
            rows = stream.read(HEAD_CHARACTERS).partition("\nLatitude,")[2]
    except OSError:
        return file  # a message about the file follows when it is read
    return file if "\n" in rows.strip() else None


def _shapes(path: Path, of_agopengps: Callable[[Path], ShapeFile]) -> ShapeFile:
    try:
        with _unpacked_path(path) as place:
            if not place.is_dir():
                return _with_origin(_read_file(place), place)
            return _of_folder(place, of_agopengps)
    except (ValueError, RecursionError) as error:
        raise ScenarioError(str(error)) from None
    except OSError as error:
        raise ScenarioError(f"{path}: cannot be read: {error.strerror or error}; choose another file") from None


def _read_file(path: Path) -> ShapeFile:
    """Return the shapes in a file. The file name is the default name of the field."""
    if path.name.upper() == TASKDATA:
        return _task_data(path)
    found = read_shapes(str(path.absolute()), MAX_BYTES, READERS)
    return replace(found, name=found.name or path.stem)


@contextmanager
def _unpacked_path(path: Path) -> Iterator[Path]:
    """Yield the path of a file or folder, or the temporary folder with the unpacked files of a zip archive."""
    if not path.is_dir() and not path.is_file():
        raise ScenarioError(f"{path}: {absence(path)}")
    if not zipfile.is_zipfile(path):
        yield path
        return
    with TemporaryDirectory() as place:
        folder = Path(place) / path.stem  # its name is the default name of a field
        try:
            _unpack(path, folder)
        except ZIP_ERRORS:
            refuse(path, "the zip archive is damaged or encrypted; create the archive again")
        yield folder


def _unpack(path: Path, folder: Path) -> None:
    """Write the files of a zip archive to a new folder. Raise ValueError for an archive that is too large, or that
    contains two files with the same name."""
    folder.mkdir()
    with zipfile.ZipFile(path) as archive:
        members, written = archive.infolist(), set[str]()
        if len(members) > MOST_MEMBERS or sum(each.file_size for each in members) > MOST_UNPACKED_BYTES:
            refuse(path, f"the archive exceeds {MOST_UNPACKED_BYTES / 1e6:.0f} MB unpacked; specify an unpacked file")
        for member in members:
            file = archive.extract(member, folder)
            if file in written and not member.is_dir():
                refuse(path, f"the archive contains {member.filename!r} twice; create the archive again")
            written.add(file)


def _of_folder(folder: Path, of_agopengps: Callable[[Path], ShapeFile]) -> ShapeFile:
    """Return the shapes of the first source in a folder or, if there is none, in its direct subfolders. A note reports
    other sources."""
    if sources := _sources_in(folder):
        found = of_agopengps(sources[0]) if sources[0].is_dir() else _read_file(sources[0])
        if len(sources) > 1:
            many = f"only {sources[0].name!r} is read, the first of {len(sources)} sources; specify the path of one"
            found = replace(found, notes=(*found.notes, many))
        return found
    return refuse(folder, f"the folder contains no field; specify a folder with {TASKDATA} or Boundary.txt, or a file")


def _sources_in(folder: Path) -> list[Path]:
    """Return the sources in a folder or, if there are none, in its direct subfolders."""
    subfolders = sorted(each for each in folder.iterdir() if each.is_dir())
    return _sources(folder) or [source for each in subfolders for source in _sources(each)]


def _sources(place: Path) -> list[Path]:
    """Return the sources in a folder: the folder itself if it is of AgOpenGPS, the task data, or all files of the
    preferred format."""
    if is_folder_of_field(place):
        return [place]
    if tasks := [each for each in place.iterdir() if each.name.upper() == TASKDATA]:
        return tasks[:1]
    files = [each for each in sorted(place.iterdir()) if each.suffix.lower() in PREFERRED and each.is_file()]
    best = min((PREFERRED.index(each.suffix.lower()) for each in files), default=0)
    return [each for each in files if each.suffix.lower() == PREFERRED[best]]


def _with_origin(found: ShapeFile, path: Path) -> ShapeFile:
    """Return the shapes of a file, with the geographic position of the local plane for an AgOpenGPS file."""
    file = path.parent / "Field.txt"
    if found.crs or not file.is_file() or not is_folder_of_field(path.parent) or path.suffix.lower() != ".txt":
        return found
    origin, notes = read_origin(file.read_text(encoding="utf-8-sig", errors="replace")[:10_000]), found.notes
    if any("row" in shape.columns for shape in found.shapes):
        notes = (*notes, f"the coordinates are assumed to be relative to the start fix in {file.name}")
    return replace(found, origin=origin, name=path.parent.absolute().name, notes=notes)


def _boundaries(folder: Path) -> ShapeFile:
    files = [folder / name for name in BOUNDARIES if (folder / name).is_file()]
    if not files or files[0].name != BOUNDARIES[0]:
        refuse(folder, f"the folder has no {BOUNDARIES[0]}; create a boundary in the guidance program")
    found = [_with_origin(_read_file(file), file) for file in files]
    return replace(found[0], shapes=tuple(shape for each in found for shape in each.shapes))


def _tracks(folder: Path) -> ShapeFile:
    for file in (folder / name for name in PLANS):
        if file.is_file() and (found := _with_origin(_read_file(file), file)).shapes:
            return found
    return refuse(folder, f"the folder has no lines in {' or '.join(PLANS)}; record a path or create a line")


def _task_data(path: Path) -> ShapeFile:
    files = {each.name.upper(): each for each in path.parent.iterdir() if each.is_file()}
    if path.stat().st_size > MAX_BYTES:
        refuse(path, f"the file is larger than {MAX_BYTES / 1e6:.0f} MB; split the file")
    try:
        root = parsed_xml(decode(path.read_bytes()))
        for reference in root.findall("XFR"):
            file = files.get(f"{reference.get('A', '').upper()}.XML")
            if file is not None and file.stat().st_size <= MAX_BYTES:
                root.extend(parsed_xml(decode(file.read_bytes())))
        return read_task_data(ElementTree.tostring(root, encoding="unicode"))
    except ValueError as error:
        refuse(path, str(error))
