"""Lines that the tests execute, by folder of the package, from coverage's data; status 1 below the share that is asked.

python scripts/covered.py [--least 95] [--missing]
"""

import argparse
import json
import tempfile
from collections import defaultdict
from pathlib import Path

from coverage import Coverage

from agrobot_mj.core.markdown import markdown_table


def folders(report: dict[str, dict[str, dict[str, int]]]) -> dict[str, tuple[int, int]]:
    """Statements and how many of them were executed, by folder."""
    found: dict[str, list[int]] = defaultdict(lambda: [0, 0])
    for file, told in report["files"].items():
        inside = Path(file).parts[Path(file).parts.index("agrobot_mj") + 1 :]
        row = found[inside[0] if len(inside) > 1 else "."]
        row[0] += told["summary"]["num_statements"]
        row[1] += told["summary"]["covered_lines"]
    return {folder: (row[0], row[1]) for folder, row in sorted(found.items())}


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--least", type=float, default=95.0, help="share asked for [%%]")
    parser.add_argument("--missing", action="store_true", help="name the lines that no test executes")
    given, coverage = parser.parse_args(), Coverage()
    coverage.load()
    if given.missing:
        coverage.report(show_missing=True, skip_covered=True)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "coverage.json"
        coverage.json_report(outfile=str(file))
        table = folders(json.loads(file.read_text()))
    lines, covered = (sum(row[k] for row in table.values()) for k in (0, 1))
    every = (*table.items(), ("together", (lines, covered)))
    rows = [(name, all_of, f"{some / all_of:.1%}" if all_of else "-") for name, (all_of, some) in every]
    print(markdown_table(("folder", "statements", "executed"), rows))
    return int(100.0 * covered < given.least * lines)


if __name__ == "__main__":
    raise SystemExit(main())
