"""Damaged boundaries and plans in all file formats, and hostile options of the field commands."""

import io
import json
import random
import re
import zipfile
from functools import cache
from pathlib import Path

from commands import bend
from field_shapes import RECTANGLE, default_plan
from field_texts import FILES, aog
from hostile import NUMBERS, bent, odd_lines, spoil
from judge import call

from agrobot_mj.extensions.fields.plan import to_json

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


CLASSES = {"fields": (fields, 0.12, plans)}
