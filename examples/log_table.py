"""Table of public logs: `python examples/log_table.py LOGS.toml` adds one row per log and release to LOGS.md.

The twin of each log is fitted to the first part of the log and predicts the second part. Existing rows are never
changed: a second run with the same release skips the log. LOGS.toml lists the downloaded files, relative to its folder:

[[log]]
name = "tractor, 4 May"
files = ["field.csv"]
map = "map.toml"                                          # not for formats with known columns
set = ["machine=utility", "tractor.wheelbase_m=2.55"]     # known parameters of the machine
share = 0.6                                               # fraction of the time for the fit
"""

import sys
import tomllib
from pathlib import Path
from typing import Any

from agrobot_mj.cli.options import overrides
from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.core.markdown import markdown_table
from agrobot_mj.core.table_columns import loaded
from agrobot_mj.core.version import __version__
from agrobot_mj.extensions.logs.maps import read_map
from agrobot_mj.extensions.logs.readers import open_log
from agrobot_mj.extensions.logs.twin.twin import SHARE, twin
from agrobot_mj.scenario.loading import load_scenario
from agrobot_mj.simulation.results import atomic

HEAD = (
    *("release", "log", "held out [s]", "10 s windows rms / p95 [cm]", "open loop rms / end [m]"),
    *("yaw rate explained", "known", "fitted"),
)


def cells(log: dict[str, Any], folder: Path) -> tuple[str, ...]:
    """Return the table cells of a log, without release and name. An unusable log has the reason in its last cell."""
    try:
        scenario = load_scenario("straight_line", overrides(log.get("set")))
        opened = [open_log(folder / file) for file in log["files"]]
        log_map = read_map(folder / log["map"]) if "map" in log else opened[0].checked_map()
        found = twin([loaded(each.source) for each in opened], log_map, scenario, log.get("share", SHARE))
    except ScenarioError as error:
        return "-", "-", "-", "-", _known(log), str(error).replace("|", "/")
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


def _known(log: dict[str, Any]) -> str:
    return ", ".join(log.get("set", [])) or "-"


def _scaled(value: float | None, factor: float, digits: int = 1) -> str:
    return "-" if value is None else f"{factor * value:.{digits}f}"


def rows_of(text: str) -> list[tuple[str, ...]]:
    """Return the rows of a table written by this script."""
    return [tuple(map(str.strip, line.strip("|").split(" | "))) for line in text.splitlines()[2:] if line]


def main(arguments: list[str]) -> int:
    """Add the missing rows to the table of a TOML file; return the exit status."""
    if len(arguments) != 1 or not Path(arguments[0]).is_file():
        print("usage: python examples/log_table.py LOGS.toml", file=sys.stderr)
        return 2
    source = Path(arguments[0])
    table = source.with_suffix(".md")
    rows = rows_of(table.read_text(encoding="utf-8")) if table.is_file() else []
    for log in tomllib.loads(source.read_text(encoding="utf-8"))["log"]:
        if (__version__, log["name"]) not in {row[:2] for row in rows}:
            rows.append((__version__, log["name"], *cells(log, source.parent)))
            with atomic(table) as part:
                part.write_text(markdown_table(HEAD, rows) + "\n", encoding="utf-8")
    print(table.read_text(encoding="utf-8"), end="")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
