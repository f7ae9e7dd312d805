"""Generate reference pages (columns, faults, numbers), provenance marks and models/drawn/ from the code."""

import re
import tomllib
from collections.abc import Iterable, Iterator
from functools import reduce
from typing import Any, NamedTuple

from blocks import DOCS, page, put
from drawn_models import files
from provenance import checked

from agrobot_mj.control.base import YAW_COLUMNS
from agrobot_mj.control.supervisor import Supervisor
from agrobot_mj.core.markdown import markdown_table
from agrobot_mj.core.resources import sweep_files
from agrobot_mj.core.signals import Column
from agrobot_mj.core.spec import Spec, members
from agrobot_mj.core.walk import keys
from agrobot_mj.faults import Fault, Scripted
from agrobot_mj.metrics import METRICS
from agrobot_mj.plants.mujoco.implement import COLUMNS as IMPLEMENT_COLUMNS
from agrobot_mj.scenario.plugins import load_installed
from agrobot_mj.scenario.reference import TableClass, document, families, first_line
from agrobot_mj.scenario.schema import Scenario, resolve
from agrobot_mj.sensors import Sensors
from agrobot_mj.simulation.columns import SIGNALS, WHEEL_SIGNALS

NUMBERS = re.compile(r"<!-- (numbers of (\[\[?)([\w.]+)\]\]?((?: \w+)*)) -->")
"""Pattern of the comment before a table of numbers. The comment contains a scenario table `[table]`, or `[[table]]` for
a list of tables, and kinds."""
HELPERS = {"sensors": {name: {"enabled": True} for name in ("gyro", "imu", "wheel_speed")}}
"""Overrides that enable the sensors required by estimators."""
HEAD = """# Columns of signals.parquet

Each row is a tick of 0.05 s. Values are float64 in SI units, angles in radians; missing values are null. Each field of
the file has its `unit` and `description` as metadata. The frame is ENU; yaw is counter-clockwise from east; steering,
yaw rate and lateral quantities are left positive. This page is written by `make reference` from
`agrobot_mj/simulation/columns.py` and from the columns of the stages.
"""


METRICS_HEAD = """## metrics.json

Metrics in addition to `outcome` and the cost of the run; missing values are null. `table.value` is a value inside a
table. Studies have columns with the same names and units. `xte_cause`, `xte_remedy` and `estimate_warning` are texts
about [the estimate](../estimators.md#what-a-run-reports-of-its-estimate).
"""


REPORTING = {"Guidance": "guidance", "Yaw controller": "controller", "Steering loop": "steering.loop"}
REPORTING |= {"Estimator": "estimator"}
"""Scenario tables whose kinds have log columns, by section title."""
load_installed()  # registers the kinds of extensions


def reference() -> str:
    """Return the page of all log columns as Markdown."""
    own = {column.name for column in YAW_COLUMNS}
    parts = [HEAD, _section("Every log", (signal.column for signal in SIGNALS))]
    parts.append(_section("Plants with wheels", WHEEL_SIGNALS))
    parts.append(_section("MuJoCo plant with an implement", IMPLEMENT_COLUMNS))
    parts.append(_section("Supervisor", Supervisor().columns))
    known = {key.dotted: key.kinds for key in keys(Scenario)}
    for title, table in REPORTING.items():
        for kind, spec in ((kind, spec()) for kind, spec in known[table].items() if _ours(spec)):
            if columns := [column for column in spec.columns if column.name not in own]:
                parts.append(_section(f"{title} `{kind}`", columns))
    sensors = {name: _all_on(sensor) for name, sensor in Sensors().all.items() if _ours(type(sensor))}
    parts += [_section(f"Sensor `{name}`", sensor.columns) for name, sensor in sensors.items() if sensor.columns]
    metrics = [_section(f"Metric `{metric.kind}`", metric.columns) for metric in METRICS if _ours(type(metric))]
    parts += [METRICS_HEAD, *metrics]
    return "\n".join(parts)


def _ours(kind: type) -> bool:
    return kind.__module__.startswith("agrobot_mj.")


def _all_on(part: Any) -> Any:
    inner = {name: _all_on(value) for name, value in part if isinstance(value, Spec)}
    return part.model_copy(update=inner | ({"enabled": True} if "enabled" in type(part).model_fields else {}))


def _section(title: str, columns: Iterable[Column]) -> str:
    """Return a heading and a table of log columns. Columns that differ only in an index or wheel share a row."""
    found: dict[tuple[str, str, str], list[str]] = {}
    for column in columns:
        stem, index = INDEXED.findall(column.name)[0]
        text = re.sub(rf"\b{index}\b", "@", column.description) if index else column.description
        found.setdefault((f"{stem}_@" if index else stem, column.unit, text), []).append(index)
    rows = []
    for (name, unit, text), indices in found.items():
        few, joint = (indices, ", ") if len(indices) <= MOST_LISTED else ((indices[0], indices[-1]), " to ")
        names = joint.join(f"`{name.replace('@', index)}`" for index in few)
        rows.append((names, unit, text.replace("@", joint.join(few))))
    return f"## {title}\n\n{markdown_table(('column', 'unit', 'description'), rows)}\n"


INDEXED = re.compile(r"^(.+?)(?:_(\d+(?:_\d+)*|[fri][lr]))?$")  # Pattern of a column name: stem, then index or wheel
MOST_LISTED = 4  # Maximum number of columns listed individually in a row: the four wheels


class Number(NamedTuple):
    """Numeric scenario key whose default value has a source."""

    owner: str  # Class that defines the key, with the name of the key
    kind: str  # Kind of the table that contains the key, or empty
    row: tuple[str, ...]  # Key, default, unit, range and source


def numbers_in(text: str) -> dict[str, list[Number]]:
    """Return the numeric keys for each table of numbers that a comment on the page marks."""
    marks, seen = NUMBERS.findall(text), set[tuple[str, str]]()
    apart, tables = {table for _, _, table, _ in marks}, dict[str, list[Number]]()
    for name, brackets, table, kinds in marks:
        tables[name] = []
        for kind in [kind for kind in kinds.split() if kind in families()[table]] if kinds else [""]:
            for number in _numbers(_default(brackets, table, kind), "", table, apart):
                if (number.owner, number.row[1]) not in seen:
                    tables[name].append(number._replace(kind=kind))
                    seen.add((number.owner, number.row[1]))
    return tables


def with_numbers(text: str) -> str:
    for name, found in numbers_in(text).items():
        several = len({number.kind for number in found}) > 1
        heads = ("kind",) * several + ("key", "default", "unit", "range and source")
        text = put(text, name, markdown_table(heads, ((f"`{n.kind}`",) * several + n.row for n in found)))
    return text


def _default(brackets: str, table: str, kind: str) -> Any:
    """Return the part of the default scenario to which the comment of a table of numbers (`NUMBERS`) refers."""
    tables, item = table.split("."), {"kind": kind} if kind else {}
    inner: Any = [item] if brackets == "[[" else item
    data: Any = reduce(lambda below, name: {name: below}, reversed(tables), inner)
    part: Any = reduce(getattr, tables, resolve(data if "sensors" in data else HELPERS | data, "docs"))
    return part[0] if brackets == "[[" else part


def _numbers(part: Spec, prefix: str, table: str, apart: set[str]) -> Iterator[Number]:
    """Yield the numeric keys of a table whose default values have a source. Nested tables are included, except tables
    with kinds and tables that have a separate table on the page."""
    place = TableClass((), type(part), part)
    for key in type(part).model_fields:
        value, doc = getattr(part, key), document(place, key)
        if isinstance(value, Spec) and not hasattr(value, "kind") and f"{table}.{key}" not in apart:
            yield from _numbers(value, f"{prefix}{key}.", f"{table}.{key}", apart)
        elif doc.source and isinstance(value, int | float) and not isinstance(value, bool):
            first = next(base for base in reversed(type(part).__mro__) if key in getattr(base, "model_fields", {}))
            source = re.sub(r"^[Aa]ssumed value[:,;]? ?(?:\(([^()]*)\))?", r"\1", doc.source)
            yield Number(f"{first.__name__}.{key}", "", (f"`{prefix}{key}`", f"{value:g}", doc.unit, source))


def kinds_table() -> str:
    """Return a table that lists the kinds of each scenario table in `TABLES`."""
    found: dict[str, list[str]] = {}
    for key in keys(Scenario):
        known = [kind for kind, part in key.kinds.items() if part.__module__.startswith("agrobot_mj.")]
        if known and key.dotted in TABLES:
            found[key.dotted] = known
    return markdown_table(("table", "kinds"), ((f"`[{t}]`", ", ".join(f"`{k}`" for k in found[t])) for t in TABLES))


TABLES = (
    *("plant", "implement", "plant.tyre", "terrain", "path", "guidance", "steering.loop", "controller", "estimator"),
)
"""Scenario tables with kinds, in the order of the page. Faults have a separate page."""


def faults_table() -> str:
    """Return a table of all faults. A row contains the kind, the first line of the docstring as effect, and the
    keys."""
    rows = []
    for kind, part in members(Fault).items():
        place = TableClass((), part, part.model_construct(kind=kind))
        own = [_key(place, key) for key in part.model_fields if key not in Scripted.model_fields]
        rows.append((f"`{kind}`", first_line(part, kind).rstrip("."), ", ".join(own)))
    return markdown_table(("kind", "effect", "keys"), rows)


def _key(place: TableClass, key: str) -> str:
    doc, default = document(place, key), getattr(place.default, key, 0.0)
    what = re.split(r"(?<=\.) ", " ".join(doc.text.replace("`", '"').split()), maxsplit=1)[0].rstrip(".")
    return f"`{key}`" if isinstance(default, int | float) else f"`{key}` ({what[0].lower()}{what[1:]})"


def sweeps_table() -> str:
    """Return a table of all shipped sweeps: title, varied keys, and initial comment of the file."""
    rows = []
    for name, file in sweep_files().items():
        text = file.read_text("utf-8")
        head = " ".join(line.removeprefix("#").strip() for line in text.partition("title =")[0].splitlines())
        measured = re.split(r"[;.] ", head.partition("Look at: ")[2], maxsplit=1)[0].rstrip(".")
        data = tomllib.loads(text)
        rows.append((f"`{name}`", data["title"], ", ".join(_varied(data)), measured))
    return markdown_table(("name", "title", "varies", "look at"), rows)


def _varied(data: dict[str, Any]) -> Iterator[str]:
    """Yield texts about the varied keys of a sweep: number of variants, each axis with its number of values, and random
    keys."""
    if variants := data.get("variant"):
        yield f"{len(variants)} variant{'s' * (len(variants) > 1)}"
    for key, values in data.get("axes", {}).items():
        yield f"`{key}` ({len(values)})" if isinstance(values, list) else f"`{key}`"
    if draws := data.get("draws"):
        yield f"{len(draws)} drawn keys" if len(draws) > MOST_DRAWS else ", ".join(f"`{key}`" for key in draws)


MOST_DRAWS = 4  # Maximum number of draws of a sweep that are listed by name


TABLES_OF = {
    "scenarios": {"kinds": kinds_table},
    "faults": {"faults": faults_table},
    "sweeps": {"sweeps": sweeps_table},
}
"""Functions that return the content of blocks, by page and by block."""


def with_tables(page: str, text: str) -> str:
    return reduce(lambda whole, name: put(whole, name, TABLES_OF[page][name]()), TABLES_OF[page], text)


if __name__ == "__main__":
    page("columns").write_text(reference(), encoding="utf-8")
    models = page("models")
    models.write_text(with_numbers(models.read_text(encoding="utf-8")), encoding="utf-8")
    for name in TABLES_OF:
        file = page(name)
        file.write_text(with_tables(name, file.read_text(encoding="utf-8")), encoding="utf-8")
    for path, text in files().items():
        path.write_text(text, encoding="utf-8")
    for file in DOCS.rglob("*.md"):  # last, because models/ affects the digest
        file.write_text(checked(file.read_text(encoding="utf-8")), encoding="utf-8")
