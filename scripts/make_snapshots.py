"""Draw the pictures of docs/recordings.md: each tab of four recordings, a comparison, and docs/images/recording.jpg.

Needs what `agrobot-mj snapshot` needs; takes two minutes. The viewer's title bar, with its remarks on the machine that
draws, is cut off; pictures are scaled to a width of 1280 pixels, so that all together stay below 6 MB.
"""

import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from PIL import Image

from agrobot_mj import load_scenario, run
from agrobot_mj.recording import Recording, write_comparison
from agrobot_mj.recording.transport.snapshot import SnapshotError, snapshots

TIMES_S = {"figure_eight": 103.0, "side_slope_10": 30.0, "furrows_across": 25.0, "gnss_loss_in_turn": 44.5}
"""Time of the picture of each scenario [s]."""
COVER = "figure_eight", "drive"
"""Picture that stands alone, also in the README."""
COMPARED, COMPARED_S = ("figure_eight", {"duration_s": 120}), 40.0
"""Scenario of the comparison, and the time of its picture [s]."""
TITLE_BAR, WIDTH, QUALITY = 37, 1280, 85
"""Height of the viewer's title bar and width of a picture [pixels], and quality of its compression."""
IMAGES = Path(__file__).parents[1] / "docs" / "images"


def main() -> int:
    """Draw all pictures; returns the exit status."""
    with tempfile.TemporaryDirectory() as folder:
        try:
            for name, t in TIMES_S.items():
                file = Path(folder) / f"{name}.rrd"
                run(load_scenario(name), (Recording(file),))
                publish(file, name, t)
            logs = [
                (
                    f"{plant}-{kind}",
                    run(load_scenario(COMPARED[0], {**COMPARED[1], "plant.kind": plant, "controller.kind": kind})),
                )
                for plant in ("bicycle", "mujoco")
                for kind in ("pd", "pd_t2fnn")
            ]
            file = Path(folder) / "comparison.rrd"
            write_comparison(logs, file)
            publish(file, "comparison", COMPARED_S, ["drive"])
        except SnapshotError as error:
            print(error, file=sys.stderr)
            return 1
    return 0


def publish(file: Path, name: str, t: float, tabs: Sequence[str] = ()) -> None:
    """Draw `tabs` of the recording `file` at time `t` [s], all if none is named, as pictures that begin with `name`."""
    written = snapshots(file, [t], file.parent / name, tabs)
    for picture in written:
        tab = picture.stem.partition("_")[0]
        shrink(picture, IMAGES / "recordings" / f"{name}_{tab}.jpg")
        if (name, tab) == COVER:
            shrink(picture, IMAGES / "recording.jpg")
    print(f"{name}: {len(written)} pictures", flush=True)


def shrink(picture: Path, target: Path) -> None:
    """Write `picture` to `target`, smaller and without the title bar."""
    target.parent.mkdir(parents=True, exist_ok=True)
    with Image.open(picture) as whole:
        kept = whole.convert("RGB").crop((0, TITLE_BAR, whole.width, whole.height))
    small = kept.resize((WIDTH, round(WIDTH * kept.height / kept.width)), Image.Resampling.LANCZOS)
    small.save(target, quality=QUALITY, subsampling=0, optimize=True)


if __name__ == "__main__":
    sys.exit(main())
