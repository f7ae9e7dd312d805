"""docs/real_machine.md: a machine that exists beside its twin. Reads public logs, of which nothing is copied.

    git clone https://github.com/jones2126/tractor2025 ../tractor2025
    git clone https://github.com/BL08FR/AOG-Canbus-tools-program-s ../canbus
    python scripts/real_machine.py --data ../tractor2025 --can ../canbus

Both are read at the commits that `riding_tractor/logs.py` states. Without `--can` the steering of the full-size tractor
stays as the page has it. Other parts by name: calibration, prediction, relaxation, closed_loop, slip, turns, gnss, can.
"""

import argparse
import tempfile
from pathlib import Path

from blocks import put
from provenance import ROOT, statement
from riding_tractor.comparison import Comparison
from riding_tractor.logs import RIDING_TRACTOR, STEERING_BUS, Repository
from riding_tractor.parts import PARTS


def main(arguments: list[str] | None = None) -> None:
    """Write the parts of the page that are asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("part", nargs="*", choices=[*PARTS, []], help=f"{', '.join(PARTS)}; all if left out")
    parser.add_argument("--data", type=Path, required=True, help="clone with the logs of the riding tractor")
    parser.add_argument("--can", type=Path, help="clone with the CAN logs")
    parser.add_argument("--docs", type=Path, default=ROOT / "docs", help="folder of the page")
    given = parser.parse_args(arguments)
    page = given.docs / "real_machine.md"
    with tempfile.TemporaryDirectory() as work:
        bus = Repository(given.can, *STEERING_BUS) if given.can else None
        comparison = Comparison(Repository(given.data, *RIDING_TRACTOR), bus, given.docs / "images", Path(work))
        for name in given.part or PARTS:
            made = PARTS[name](comparison)
            text = put(page.read_text("utf-8"), "standing", statement())
            for block, content in made.items():
                text = put(text, block, content)
            page.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
