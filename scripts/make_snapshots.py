"""Render the recording images of the documentation: tabs in docs/recordings.md, a comparison, and the gallery.

Rendering requires the dependencies of `agrobot-mj snapshot` and takes five minutes. Images are 1280 pixels wide.
Gallery images show only the tractor. All images together are smaller than 9 MB. The script writes the version and
commit to docs/recordings.md.
"""

import sys
import tempfile
import tomllib
from collections.abc import Callable, Sequence
from pathlib import Path

from blocks import DOCS, page, put
from PIL import Image
from provenance import statement

from agrobot_mj import load_scenario, run
from agrobot_mj.recording import Recording, write_comparison
from agrobot_mj.recording.transport.snapshot import SnapshotError, snapshots

PLAN = tomllib.loads(Path(__file__).with_name("snapshots.toml").read_text("utf-8"))
COVER = "figure_eight", "drive"  # Scenario and tab of the cover image
COMPARED, COMPARED_S = ("figure_eight", {"duration_s": 120}), 40.0
"""Scenario and overrides of the comparison, and time of its image [s]."""
WIDTH, QUALITY, VIEW_SIZE = 1280, 85, (640, 400)
"""Image width [pixels], JPEG quality, and size of gallery images [pixels]."""
IMAGES, PAGE = DOCS / "images", page("recordings")


def main() -> int:
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
    for name, t in PLAN["tabs"].items():
        file = folder / f"{name}.rrd"
        run(load_scenario(name), (Recording(file),))
        publish(file, name, t)


def comparison(folder: Path) -> None:
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
    """Render an image of the tractor for each tile of the gallery, and the animation."""
    for name, tile in PLAN["gallery"].items():
        file = folder / f"{name}.rrd"
        log = run(load_scenario(tile["scenario"], tile.get("set", {})), (Recording(file),))
        end = float(log.column("t")[-1])
        (picture,) = snapshots(file, [min(tile["t"], end)], folder / name, ["tractor"], size=VIEW_SIZE)
        with Image.open(picture) as whole:
            save(whole, VIEW_SIZE[0], IMAGES / f"gallery-{name}.jpg")
        if "moves_s" in tile:
            (animation,) = snapshots(file, [end - tile["moves_s"]], folder / name, ["tractor"], "gif", VIEW_SIZE)
            (IMAGES / f"gallery-{name}.gif").write_bytes(animation.read_bytes())
        print(name, flush=True)


def publish(file: Path, name: str, t: float, tabs: Sequence[str] = ()) -> None:
    """Render the `tabs` (default: all tabs) of a recording at the time `t` [s], and write images with the file-name
    prefix `name`."""
    written = snapshots(file, [t], file.parent / name, tabs)
    for picture in written:
        tab = picture.stem.rpartition("_")[0]
        with Image.open(picture) as whole:
            save(whole, WIDTH, IMAGES / "recordings" / f"{name}_{tab}.jpg")
            if (name, tab) == COVER:
                save(whole, WIDTH, IMAGES / "recording.jpg")
    print(f"{name}: {len(written)} pictures", flush=True)


def save(picture: Image.Image, width: int, target: Path) -> None:
    """Scale an image to `width` [pixels] and write it to `target`."""
    target.parent.mkdir(parents=True, exist_ok=True)
    height = round(width * picture.height / picture.width)
    small = picture.convert("RGB").resize((width, height), Image.Resampling.LANCZOS)
    small.save(target, quality=QUALITY, subsampling=0, optimize=True)


if __name__ == "__main__":
    sys.exit(main())
