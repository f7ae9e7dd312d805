"""Draw the pictures of recordings in the docs: each tab of four of docs/recordings.md, a comparison, and the gallery.

Needs what `agrobot-mj snapshot` needs; takes five minutes. Pictures are scaled to a width of 1280 pixels, those of the
gallery show the view of the tractor alone; all together stay below 9 MB. docs/recordings.md then states version
and commit.
"""

import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

from blocks import DOCS, page, put
from PIL import Image
from provenance import statement

from agrobot_mj import load_scenario, run
from agrobot_mj.recording import Recording, write_comparison
from agrobot_mj.recording.transport.snapshot import SnapshotError, snapshots

TIMES_S = {"figure_eight": 103.0, "side_slope_10": 30.0, "furrows_across": 25.0, "gnss_loss_in_turn": 44.5}
"""Time of the picture of each scenario [s]."""
COVER = "figure_eight", "drive"
"""Picture that stands alone."""
COMPARED, COMPARED_S = ("figure_eight", {"duration_s": 120}), 40.0
"""Scenario of the comparison, and the time of its picture [s]."""
WIDTH, QUALITY = 1280, 85
"""Width of a picture [pixels], and quality of its compression."""
VIEW_SIZE = 640, 400
"""Size of the pictures of the gallery, in which the tractor is alone [pixels]."""
IMAGES, PAGE = DOCS / "images", page("recordings")


class Tile(NamedTuple):
    """A picture of the gallery."""

    scenario: str
    t: float  # its time; one after the end shows the end [s]
    overrides: Mapping[str, Any] = MappingProxyType({})


GALLERY = {
    "rollover": Tile("rollover", 60.0),
    "furrows": Tile("furrows_across", 22.0, {"duration_s": 23}),
    "hills": Tile("hills", 40.0, {"duration_s": 41}),
    "ruts": Tile("ruts", 62.0, {"duration_s": 63}),
    "headland": Tile("headland_k_turn", 53.0, {"duration_s": 54}),
    "trailer": Tile("trailer_s_bend", 31.0, {"duration_s": 32}),
    "robot": Tile("circle", 8.0, {"duration_s": 9, "machine": "robot"}),
    "orchard": Tile("circle", 8.0, {"duration_s": 9, "machine": "orchard"}),
    "row_crop": Tile("circle", 8.0, {"duration_s": 9, "machine": "row_crop"}),
}
MOVING, MOVING_S = "rollover", 8.5
"""Tile that is animated as well, and how long before its end that begins [s]."""


def main() -> int:
    """Draw all pictures, or those of the parts named; returns the exit status."""
    parts: dict[str, Callable[[Path], None]] = {"tabs": tabs, "comparison": comparison, "gallery": gallery}
    with tempfile.TemporaryDirectory() as folder:
        try:
            for name in sys.argv[1:] or parts:
                parts[name](Path(folder))
        except SnapshotError as error:
            print(error, file=sys.stderr)
            return 1
    PAGE.write_text(put(PAGE.read_text("utf-8"), "standing", statement()), "utf-8")
    return 0


def tabs(folder: Path) -> None:
    """Every tab of the recordings of docs/recordings.md."""
    for name, t in TIMES_S.items():
        file = folder / f"{name}.rrd"
        run(load_scenario(name), (Recording(file),))
        publish(file, name, t)


def comparison(folder: Path) -> None:
    """Both plants with and without the network."""
    name, overrides = COMPARED
    logs = [
        (f"{plant}-{kind}", run(load_scenario(name, {**overrides, "plant.kind": plant, "controller.kind": kind})))
        for plant in ("bicycle", "mujoco")
        for kind in ("pd", "pd_t2fnn")
    ]
    file = folder / "comparison.rrd"
    write_comparison(logs, file)
    publish(file, "comparison", COMPARED_S, ["drive"])


def gallery(folder: Path) -> None:
    """The view of the tractor on each tile, and one of them as it moves."""
    for name, tile in GALLERY.items():
        file = folder / f"{name}.rrd"
        log = run(load_scenario(tile.scenario, tile.overrides), (Recording(file),))
        (picture,) = snapshots(file, [tile.t], folder / name, ["tractor"], size=VIEW_SIZE)
        with Image.open(picture) as whole:
            save(whole, VIEW_SIZE[0], IMAGES / f"gallery-{name}.jpg")
        if name == MOVING:
            start = float(log.column("t")[-1]) - MOVING_S
            (animation,) = snapshots(file, [start], folder / name, ["tractor"], True, VIEW_SIZE)
            (IMAGES / f"gallery-{name}.gif").write_bytes(animation.read_bytes())
        print(name, flush=True)


def publish(file: Path, name: str, t: float, tabs: Sequence[str] = ()) -> None:
    """Draw `tabs` of the recording `file` at time `t` [s], all if none is named, as pictures that begin with `name`."""
    written = snapshots(file, [t], file.parent / name, tabs)
    for picture in written:
        tab = picture.stem.rpartition("_")[0]
        with Image.open(picture) as whole:
            save(whole, WIDTH, IMAGES / "recordings" / f"{name}_{tab}.jpg")
            if (name, tab) == COVER:
                save(whole, WIDTH, IMAGES / "recording.jpg")
    print(f"{name}: {len(written)} pictures", flush=True)


def save(picture: Image.Image, width: int, target: Path) -> None:
    """Write `picture` to `target`, so wide [pixels]."""
    target.parent.mkdir(parents=True, exist_ok=True)
    height = round(width * picture.height / picture.width)
    small = picture.convert("RGB").resize((width, height), Image.Resampling.LANCZOS)
    small.save(target, quality=QUALITY, subsampling=0, optimize=True)


if __name__ == "__main__":
    sys.exit(main())
