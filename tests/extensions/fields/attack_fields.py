"""Damaged boundaries and plans in all file formats, and hostile options of the field commands."""

import io
import json
import random
import re
import warnings
import zipfile
from functools import cache
from pathlib import Path

import pyproj
import shapefile
from commands import bend
from field_shapes import RECTANGLE, default_plan
from field_texts import AREA, FILES, HOLE, RING, aog, degrees
from hostile import NUMBERS, bent, odd_lines, spoil
from judge import call

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.extensions.fields.plan import to_json
from agrobot_mj.extensions.fields.reading import read_field

BOUNDARY = "x,y\n0,0\n60,0\n60,40\n0,40\n"
SHORT = "--no-rrd --set plant.kind=bicycle --set duration_s=1 --out out"
COMMANDS = [
    line.split()
    for line in (
        "field show field.csv --crs EPSG:25832 --field North --out out",
        "field plan field.csv --width 6 --headlands 1 --turn k --angle 30 --radius 5 --overlap 0.2 --out out",
        "field plan field.csv --width 9 --along contours --beyond 2 --order skip --sections 3 --speed 1 --out out",
        f"field run field.csv --width 6 --sections 4 --on-delay 0.2 --off-delay 0.1 --look-ahead 0.3 {SHORT}",
        f"field run field.csv --width 6 --row-spacing 0.75 --row-angle 10 --price hour=50 --guidance lqr {SHORT}",
        f"field run field.csv --plan plan.json --price input_ha=180 {SHORT}",
    )
]
"""Command lines with the options of all field commands, for a field of 60 m by 40 m."""
LINES = [[[10, 10], [50, 10]], [[50, 16], [10, 16]]]
TABLE = "x,y,speed,working,direction\n10,10,2,on,1\n50,10,2,on,1\n55,12,0.5,off,-1\n50,16,0,off,1\n10,16,2,on,1\n"
FIELDS2COVER = "10 10 0 0 2 40 1 1\n50 10 0 1.57079632679 1 6 1 2\n50 16 0 3.14159265 2 40 1 1\n"


@cache
def plans() -> dict[str, bytes]:
    """Return a valid plan of the small field for each format, by file name."""
    lines = {"type": "MultiLineString", "coordinates": LINES}
    local = {"type": "name", "properties": {"name": "local plane in metres"}}
    drawn = {"type": "FeatureCollection", "crs": local, "features": [{"type": "Feature", "properties": {}}]}
    drawn["features"][0]["geometry"] = lines
    texts = {
        "plan.json": json.dumps(to_json(default_plan(RECTANGLE, 6.0))),
        "plan.geojson": json.dumps(drawn),
        "plan.csv": TABLE,
        "plan.wkt": "MULTILINESTRING ((10 10, 50 10), (50 16, 10 16))",
        "plan.txt": FIELDS2COVER,
    }
    return {name: text.encode() for name, text in texts.items()}


def _damaged(chance: random.Random, file: Path, content: bytes) -> None:
    """Write a file with changed bytes, lines or numbers."""
    numbers = re.findall(rb"\d+\.?\d*", content[:100_000])
    if numbers and chance.random() < 0.4:
        content = content.replace(chance.choice(numbers), chance.choice(NUMBERS).encode(), chance.choice([1, 1, -1]))
    file.write_bytes(content)
    if chance.random() < 0.7:
        changed = odd_lines(chance, file) if chance.random() < 0.3 else bent(chance, content, chance.choice([1, 5]))
        file.write_bytes(changed)


def _boundary(chance: random.Random) -> list[str]:
    """Write a damaged boundary: a file, a folder or a zip archive. Return a command that reads the boundary."""
    name, text = chance.choice([*FILES.items(), ("metres.csv", BOUNDARY)])
    place = Path(name)
    if chance.random() < 0.7:
        _damaged(chance, place, text.encode())
    else:
        place = Path("Hill")
        aog(place, chance.choice(".,")) if chance.random() < 0.5 else place.mkdir()
        if not any(place.iterdir()):
            (place / "TASKDATA.XML").write_text(FILES["v4.xml"], "utf-8")
        spoil(chance, chance.choice(sorted(place.iterdir())))
        if chance.random() < 0.4:
            place = _zipped(chance, place)
    words = ["--width", "20"] if chance.random() < 0.3 else []
    return ["field", "plan" if words else "show", str(place), *words, "--out", "out"]


def _zipped(chance: random.Random, folder: Path) -> Path:
    """Return the path of a zip archive, possibly damaged, that contains the files of a folder."""
    content, archive = io.BytesIO(), Path("hill.zip")
    with zipfile.ZipFile(content, "w") as written:
        for file in filter(Path.is_file, folder.iterdir()):
            written.write(file, chance.choice([file.name, f"x/{file.name}", f"../{file.name}", f"/{file.name}"]))
    whole = content.getvalue()
    archive.write_bytes(bent(chance, whole, 3) if chance.random() < 0.5 else whole)
    return archive


def fields(chance: random.Random) -> str:
    """Run a field command with a damaged boundary, a damaged plan, or one to three erroneous options."""
    Path("field.csv").write_text(BOUNDARY)
    Path("plan.json").write_bytes(plans()["plan.json"])
    kind = chance.random()
    if kind < 0.45:
        return call(_boundary(chance))
    if kind < 0.75:
        name, content = chance.choice(list(plans().items()))
        _damaged(chance, Path(name), content)
        return call(["field", "run", "field.csv", "--plan", name, *SHORT.split()])
    words = list(chance.choice(COMMANDS))
    for _ in range(chance.randint(1, 3)):
        bend(chance, words)
    return call(words)


Files = dict[str, bytes]
"""Contents of the files of one field, by name."""
GRID = "EPSG:3301"  # Coordinate system of the shapefiles
CODECS = ("utf-8-sig", "utf-16", "utf-16-le", "utf-32", "cp1252", "latin-1", "ascii")
SLACK = 0.02  # Maximum relative error of the area of a field that is read correctly


@cache
def sources() -> dict[str, Files]:
    """Return valid files of the same field for each type of shapefile and for each text format, by name."""
    grid = pyproj.Transformer.from_crs("EPSG:4326", GRID, always_xy=True).transform
    rings = [[[*grid(*point), 5.0, 1.0] for point in degrees(ring)] for ring in (RING[::-1], HOLE)]
    prj = pyproj.CRS(GRID).to_wkt("WKT1_ESRI").encode()
    found: dict[str, Files] = {name: {name: text.encode()} for name, text in FILES.items()}
    for kind in ("POLYGON", "POLYGONZ", "POLYGONM", "POLYLINE", "POLYLINEZ", "MULTIPOINTZ", "POINT", "MULTIPATCH"):
        parts = {end: io.BytesIO() for end in ("shp", "shx", "dbf")}
        with shapefile.Writer(**parts, shapeType=getattr(shapefile, kind), encoding="cp1252") as writer:
            writer.field("NAME", "C")
            for ring in rings if kind[:8] == "POLYLINE" else [None]:
                _write(writer, kind, [ring] if ring else rings)
                writer.record("Grönfält")
        found[kind] = {f"a.{end}": part.getvalue() for end, part in parts.items()} | {"a.prj": prj}
    points = "".join(f'<PT lat="{y:.9f}" lon="{x:.9f}"><ele>5</ele></PT>' for x, y in degrees(RING))
    for name, start, point, end in (
        ("track.gpx", "<trk><name>Grönfält</name><trkseg>", "trkpt", "</trkseg></trk>"),
        ("route.gpx", "<rte>", "rtept", "</rte>"),
        ("marks.gpx", "", "wpt", ""),
    ):
        found[name] = {name: f"<gpx>{start}{points.replace('PT', point)}{end}</gpx>".encode()}
    return found


def _write(writer: shapefile.Writer, kind: str, rings: list[list[list[float]]]) -> None:
    """Write rings as one shape of the given kind to a shapefile."""
    if kind == "POINT":
        writer.point(*rings[0][0][:2])
    elif kind == "MULTIPOINTZ":
        writer.multipointz(rings[0])
    elif kind == "MULTIPATCH":
        writer.multipatch(rings, [shapefile.OUTER_RING, shapefile.INNER_RING])
    else:
        write = {"POLYGON": writer.poly, "POLYGONM": writer.polym, "POLYGONZ": writer.polyz}
        write |= {"POLYLINE": writer.line, "POLYLINEZ": writer.linez}
        width = {"M": 3, "Z": 4}.get(kind[-1], 2)
        write[kind]([[point[:width] for point in ring] for ring in rings])


def _recoded(chance: random.Random, files: Files) -> None:
    """Change the encoding of the texts and the names of the files."""
    codec = chance.choice(CODECS)
    for name in [name for name in files if name[-4:] not in (".shp", ".shx", ".dbf")]:
        files[name] = files[name].decode().encode(codec, errors="replace")
    if chance.random() < 0.3:
        upper = {name.upper(): content for name, content in files.items()}
        files.clear()
        files.update(upper)


def _decimal_commas(chance: random.Random, files: Files) -> None:
    for name in [name for name in files if name[-4:] not in (".shp", ".shx", ".dbf", ".prj")]:
        files[name] = re.sub(rb"(?<=\d)\.(?=\d{3})", b",", files[name])


def _lost_part(chance: random.Random, files: Files) -> None:
    if lost := [name for name in files if name[-4:] in (".shx", ".dbf", ".prj")]:
        del files[chance.choice(lost)]


def _other_parts(chance: random.Random, files: Files) -> None:
    """Replace a part of a shapefile by the same part of another shapefile, or by no bytes."""
    if "a.shx" in files:
        part = chance.choice(["a.shx", "a.dbf"])
        files[part] = chance.choice([sources()[chance.choice(["POINT", "POLYGONZ", "POLYLINE"])][part], b""])


def _no_number(chance: random.Random, files: Files) -> None:
    """Replace a coordinate by a text that is not a finite number."""
    for name in [name for name in files if name[-4:] not in (".shp", ".shx", ".dbf", ".prj")]:
        if numbers := re.findall(rb"\d+\.\d{3,}", files[name]):
            files[name] = files[name].replace(chance.choice(numbers), chance.choice([b"nan", b"1e999", b"", b"x"]), 1)


def _swapped(chance: random.Random, files: Files) -> None:
    """Exchange latitude and longitude, or specify another coordinate system."""
    for name in files:
        if name[-4:] == ".prj":
            other = chance.choice(["EPSG:4326", "EPSG:3857", "EPSG:32635", "EPSG:32601"])
            files[name] = chance.choice([pyproj.CRS(other).to_wkt().encode(), b"", b"LOCAL_CS[]", b"EPSG:3301"])
        elif name[-4:] not in (".shp", ".shx", ".dbf"):
            pair = rb"(\d+\.\d{9})(\D{1,9})(\d+\.\d{9})"
            files[name] = re.sub(pair, rb"\3\2\1", files[name])


def _spoilt(chance: random.Random, files: Files) -> None:
    name = chance.choice(list(files))
    files[name] = bent(chance, files[name], chance.choice([1, 5])) if files[name] else b""


KEPT = (_recoded, _decimal_commas, _lost_part, _other_parts, _no_number)
"""Changes after which a field has its true area, has a reported problem, or is rejected."""
DAMAGES = (*KEPT, _swapped, _spoilt)


def _packed(chance: random.Random, files: Files) -> Path:
    """Write the files, possibly to a folder or to a zip archive that also has other members. Return the path."""
    name = next((name for name in files if name.lower().endswith(".shp")), next(iter(files)))
    how = chance.choice(["file", "file", "folder", "zip", "kmz"])
    if how in ("file", "folder"):
        place = Path("farm") if how == "folder" else Path()
        place.mkdir(exist_ok=True)
        for each, content in files.items():
            (place / each).write_bytes(content)
        return place if how == "folder" else Path(name)
    archive, method = Path(f"farm.{how}"), chance.choice([zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED, zipfile.ZIP_LZMA])
    members = list(files.items())
    if chance.random() < 0.2:
        again = chance.choice([name, "x/y/z.txt", "b" + name, f"../{name}"])
        members.append((again, chance.choice([b"", b"x,y\n0,0\n"])))
    if chance.random() < 0.1:
        members.append((f"big{Path(name).suffix}", bytes(chance.choice([90, 200, 310]) * 10**6)))
    with zipfile.ZipFile(archive, "w", method) as written, warnings.catch_warnings(action="ignore"):
        for each, content in members:
            written.writestr(each, content)
    if chance.random() < 0.2:
        archive.write_bytes(bent(chance, archive.read_bytes(), 2))
    return archive


def imports(chance: random.Random) -> str:
    """Damage files of other programs at random, and read a field, a plan or a path from them. A field that is read
    without a reported problem must have its true area, unless the damage cannot be detected."""
    name, whole = chance.choice(list(sources().items()))
    files, changes = dict(whole), chance.sample(DAMAGES, chance.choice([0, 1, 1, 1, 2]))
    for change in changes:
        change(chance, files)
    place = _packed(chance, files)
    way = chance.random()
    if way < 0.2:
        words = ["--set", "path.kind=waypoints", "--set", f"path.file={place}", "--set", "path.smoothing_m=0.5"]
        found = call(["run", "straight_line", *SHORT.split(), *words])
    elif way < 0.4:
        Path("field.csv").write_text(BOUNDARY)
        found = call(["field", "run", "field.csv", "--plan", str(place), *SHORT.split()])
    else:
        words = ["--crs", chance.choice([GRID, "EPSG:4326", "EPSG:25832", "x"])] if chance.random() < 0.2 else []
        command = chance.choice([["show"], ["plan", "--width", "20"]])
        found = call(["field", *command, str(place), *words, "--out", "out"])
        if not found and not words and set(changes) <= set(KEPT):
            found = _misread(place)
    told = [name, *(change.__name__ for change in changes)]
    return f"{told}: {found}" if found else ""


def _misread(place: Path) -> str:
    """Return a message if the field in a file has a wrong area and no reported problem, otherwise an empty text."""
    try:
        field = read_field(place)
    except ScenarioError:
        return ""
    areas = (AREA, AREA + 300.0)
    right = any(abs(field.boundary.area / area - 1) < SLACK for area in areas)
    return "" if right or field.notes else f"the field {field.name!r} is read with {field.boundary.area:.0f} m2"


CLASSES = {"fields": (fields, 0.12, plans), "imports": (imports, 0.2, sources)}
