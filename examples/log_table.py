"""Table of public logs: `python examples/log_table.py LOGS.toml` adds one row per log and release to LOGS.md.

The twin of each log is fitted to the first part of the log and predicts the second part. Existing rows are never
changed: a second run with the same release skips the log. With `--files`, the script calibrates each file of a log
separately and prints the results side by side. LOGS.toml lists the downloaded files, relative to its folder:

[[log]]
name = "tractor, 4 May"
files = ["field.csv"]
map = "map.toml"                                          # not for formats with known columns
set = ["machine=utility", "tractor.wheelbase_m=2.55"]     # known parameters of the machine
share = 0.6                                               # fraction of the time for the fit
"""

import sys
import tomllib
from itertools import combinations
from math import hypot
from pathlib import Path
from typing import Any

from agrobot_mj.cli.options import overrides
from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.core.markdown import markdown_table
from agrobot_mj.core.table_columns import Source, load_table
from agrobot_mj.core.version import __version__
from agrobot_mj.extensions.logs.calibrate import calibrate
from agrobot_mj.extensions.logs.maps import LogMap, read_map
from agrobot_mj.extensions.logs.quantities import Quantity
from agrobot_mj.extensions.logs.readers import open_log
from agrobot_mj.extensions.logs.twin.twin import SHARE, twin
from agrobot_mj.scenario import Scenario
from agrobot_mj.scenario.loading import load_scenario
from agrobot_mj.simulation.results import atomic

HEAD = (
    *("release", "log", "held out [s]", "10 s windows rms / p95 [cm]", "open loop rms / end [m]"),
    *("yaw rate explained", "known", "fitted"),
)


NORMAL = 1.96  # Half width of a 95 % interval, divided by the standard error [-]


def opened(log: dict[str, Any], folder: Path) -> tuple[list[Source], LogMap, Scenario]:
    """Return the files of a log, their common map, and the scenario of the machine."""
    scenario = load_scenario("straight_line", overrides(log.get("set")))
    found = [open_log(folder / file) for file in log["files"]]
    log_map = read_map(folder / log["map"]) if "map" in log else found[0].checked_map()
    return [load_table(each.source) for each in found], log_map, scenario


def cells(log: dict[str, Any], folder: Path) -> tuple[str, ...]:
    """Return the table cells of a log, without release and name. For an unusable log, the last cell states the
    reason."""
    try:
        found = twin(*opened(log, folder), log.get("share", SHARE))
    except ScenarioError as error:
        return "-", "-", "-", "-", _known(log), f"rejected: {error}".replace("|", "/")
    m = found.held_out.metrics
    place, rate = m["position"] or {}, m["yaw_rate"] or {}
    fitted = [key for key, each in found.found.items() if each.identified]
    return (
        f"{m['duration_s']:.0f}",
        f"{_scaled(place.get('windows_rms'), 100)} / {_scaled(place.get('windows_p95'), 100)}",
        f"{_scaled(place.get('rms'), 1, 2)} / {_scaled(place.get('at_the_end'), 1, 2)}",
        f"{_scaled(rate.get('explained'), 100, 0)}%",
        _known(log),
        ", ".join(fitted) or "-",
    )


def by_file(log: dict[str, Any], folder: Path) -> str:
    """Return a table with the calibration of each file, and with the largest difference between two files.

    Quantities that a file does not identify are in parentheses.
    """
    sources, *known = opened(log, folder)
    found, lines = [calibrate([source], *known).found for source in sources], []
    for key in dict.fromkeys(key for each in found for key in each):
        told = [each.get(key) for each in found]
        pairs = combinations(filter(None, told), 2)
        off = [NORMAL * abs(a.value - b.value) / hypot(a.half, b.half) for a, b in pairs]
        lines.append((f"`{key}`", *map(_interval, told), f"{max(off):.1f}" if off else "-"))
    heads = ("quantity", *(Path(file).stem for file in log["files"]), "largest difference [standard errors]")
    return markdown_table(heads, lines)


def _interval(quantity: Quantity | None) -> str:
    if quantity is None:
        return "-"
    text = f"{quantity.text} [{', '.join(quantity.ends)}]"
    return text if quantity.identified else f"({text})"


def _known(log: dict[str, Any]) -> str:
    return ", ".join(log.get("set", [])) or "-"


def _scaled(value: float | None, factor: float, digits: int = 1) -> str:
    return "-" if value is None else f"{factor * value:.{digits}f}"


def rows_of(text: str) -> list[tuple[str, ...]]:
    """Return the rows of a Markdown table that this script has written."""
    return [tuple(map(str.strip, line.strip("|").split(" | "))) for line in text.splitlines()[2:] if line]


def main(arguments: list[str]) -> int:
    """Add the missing rows to the table of a TOML file, and return the exit status."""
    *options, file = arguments or [""]
    if options not in ([], ["--files"]) or not Path(file).is_file():
        print("usage: python examples/log_table.py [--files] LOGS.toml", file=sys.stderr)
        return 2
    source = Path(file)
    logs = tomllib.loads(source.read_text(encoding="utf-8"))["log"]
    if options:
        print("\n\n".join(f"{log['name']}\n\n{by_file(log, source.parent)}" for log in logs))
        return 0
    table = source.with_suffix(".md")
    rows = rows_of(table.read_text(encoding="utf-8")) if table.is_file() else []
    for log in logs:
        if (__version__, log["name"]) not in {row[:2] for row in rows}:
            rows.append((__version__, log["name"], *cells(log, source.parent)))
            with atomic(table) as part:
                part.write_text(markdown_table(HEAD, rows) + "\n", encoding="utf-8")
    print(table.read_text(encoding="utf-8"), end="")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
