"""Draws the pictures of docs/recordings.md: each tab of four recordings, and docs/images/recording.jpg.

Needs what `agrobot-mj snapshot` needs; takes about a minute. Pictures are scaled to 1280 pixels, so that all together
stay below 6 MB.
"""

import sys
import tempfile
from pathlib import Path

from PIL import Image

from agrobot_mj import load_scenario, run
from agrobot_mj.recording import Recording
from agrobot_mj.recording.transport.snapshot import SnapshotError, snapshots

TIMES_S = {"figure_eight": 103.0, "side_slope_10": 30.0, "furrows_across": 25.0, "gnss_loss_in_turn": 44.5}
"""When each scenario is looked at."""
COVER = "figure_eight", "drive"
"""The picture that stands alone, in the README too."""
SIZE, QUALITY = (1280, 720), 85
IMAGES = Path(__file__).parents[1] / "docs" / "images"


def main() -> int:
    """Draw all; returns the exit status."""
    with tempfile.TemporaryDirectory() as folder:
        for name, t in TIMES_S.items():
            file = Path(folder) / f"{name}.rrd"
            run(load_scenario(name), (Recording(file),))
            try:
                written = snapshots(file, [t], Path(folder) / name)
            except SnapshotError as error:
                print(error, file=sys.stderr)
                return 1
            for picture in written:
                tab = picture.stem.partition("_")[0]
                shrink(picture, IMAGES / "recordings" / f"{name}_{tab}.jpg")
                if (name, tab) == COVER:
                    shrink(picture, IMAGES / "recording.jpg")
            print(f"{name}: {len(written)} pictures", flush=True)
    return 0


def shrink(picture: Path, target: Path) -> None:
    """Write `picture` to `target`, smaller and with fewer colours."""
    target.parent.mkdir(parents=True, exist_ok=True)
    with Image.open(picture) as whole:
        small = whole.convert("RGB").resize(SIZE, Image.Resampling.LANCZOS)
    small.save(target, quality=QUALITY, subsampling=0, optimize=True)


if __name__ == "__main__":
    sys.exit(main())
