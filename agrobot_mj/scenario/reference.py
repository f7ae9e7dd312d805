"""Reference of the keys of scenario files: kinds of each table, explanation of a key, and JSON schema for editors."""

import inspect
import json
import re
from difflib import SequenceMatcher
from functools import cache
from typing import Any, NamedTuple

from agrobot_mj.core.errors import ScenarioError, shorten
from agrobot_mj.core.spec import UNPRINTABLE, Spec, members
from agrobot_mj.core.walk import TableClass, alternatives, keys, named_by, places
from agrobot_mj.metrics import METRICS, Metric
from agrobot_mj.scenario.schema import Scenario
from agrobot_mj.sensors import Sensors

CITATION = re.compile(r"[A-Z]\w*\d{4}")  # Pattern of a citation key in brackets. Other brackets contain a unit.
SOURCE = re.compile(r"(?:^|(?<=[.;]\s))((?:Assumed|assumed|Paper)\b.*)$", re.DOTALL)
"""Pattern of the sentence in a description that gives the source of a value."""
SHORTEST_WORD = 3  # Minimum number of letters of a search word
BOUNDS = {"exclusiveMinimum": "above", "minimum": "at least", "exclusiveMaximum": "below", "maximum": "at most"}
TYPES = {
    "number": "number",
    "integer": "whole number",
    "string": "text",
    "boolean": "true or false",
    "null": "omitted",
}


class Doc(NamedTuple):
    """Documentation of one key of a scenario file."""

    text: str  # Description without the sentence about the source
    unit: str  # Unit in the description, or an empty string for a key without unit
    source: str  # Source of the default, or an empty string if the description gives none
    kind: str
    default: str  # Default value as TOML text


def families() -> dict[str, dict[str, type[Spec]]]:
    """Return the class of each kind, by dotted key of the table and name of the kind."""
    return _families(Scenario.__pydantic_validator__)


@cache
def _families(built: object) -> dict[str, dict[str, type[Spec]]]:
    found: dict[str, dict[str, type[Spec]]] = {}
    for key in keys(Scenario):
        if kinds := key.kinds:
            found.setdefault(key.dotted, {}).update(kinds)
    return found


def first_line(part: type[Spec], kind: str = "") -> str:
    """Return the first line of a class docstring, without control characters. For a fault class, the name of the faulty
    signal replaces the word "signal"."""
    signal = getattr(part, "signals", {}).get(kind.rpartition("_")[0], "signal")
    return UNPRINTABLE.sub("", (part.__doc__ or "").strip().partition("\n")[0]).replace("signal", signal, 1)


class KnownKind(NamedTuple):
    """Description of one kind of a table, of one sensor, or of one metric."""

    table: str  # Dotted key of the table that contains `kind`; `sensors` for a sensor, `metric` for a metric
    kind: str  # Value of the key `kind`, or name of the sensor or metric
    text: str


def known_kinds() -> list[KnownKind]:
    """Return the accepted values of `kind` in all tables, and all sensors and metrics, each with a description."""
    known = families()
    outer = {key: [other for other in known if key.startswith(f"{other}.")] for key in known}
    found = [
        KnownKind(key, kind, first_line(part, kind))
        for key, kinds in known.items()
        for kind, part in kinds.items()
        if all(known[other].get(kind) is not part for other in outer[key])
    ]
    sensors = {name: members(field.annotation) for name, field in Sensors.model_fields.items()}
    found += [KnownKind("sensors", name, first_line(next(iter(parts.values())))) for name, parts in sensors.items()]
    return [*found, *(KnownKind("metric", metric.kind, first_line(type(metric))) for metric in METRICS)]


def kinds_text() -> str:
    """Return a text that lists the accepted values of `kind` in all tables, and all sensors and metrics."""
    rows = known_kinds()
    wide = [max(len(row[k]) for row in rows) for k in (0, 1)]
    return "\n".join(f"{key:{wide[0]}}  {kind:{wide[1]}}  {line}" for key, kind, line in rows)


def document(place: TableClass, name: str) -> Doc:
    """Return the documentation of the key `name` in the table with the class `place`."""
    owner, text = place.owner, place.owner.describe(name)
    kind = _in_words(_properties(owner, owner.__pydantic_validator__)[name])
    source = SOURCE.search(text)
    if source:
        text = text[: source.start()].rstrip(" ;,.\n") + "."
    units = [unit for unit in re.findall(r"\[([^\[\]]+)\]", text) if not CITATION.fullmatch(unit)]
    default = _as_toml(getattr(place.default, name)) if hasattr(place.default, name) else "required"
    origin = " ".join(source[1].split()).rstrip(".") if source else ""
    return Doc(text, units[0] if units else "", origin, kind, default)


@cache
def _properties(owner: type[Spec], built: object) -> dict[str, Any]:
    found: dict[str, Any] = owner.model_json_schema()["properties"]
    return found


def _in_words(schema: dict[str, Any]) -> str:
    if options := schema.get("anyOf"):
        return ", or ".join(_in_words(option) for option in options)
    if "const" in schema or "enum" in schema:
        return "one of " + ", ".join(json.dumps(value) for value in schema.get("enum", [schema.get("const")]))
    if schema.get("type") == "array":
        item = schema.get("items", {})
        counts = [
            f"{word} {schema[k]}" for k, word in (("minItems", "at least"), ("maxItems", "at most")) if k in schema
        ]
        return " ".join(["list of", _in_words(item) if isinstance(item, dict) and item else "values", *counts])
    words = [TYPES.get(str(schema.get("type")), "table")]
    return ", ".join(words + [f"{word} {schema[bound]:g}" for bound, word in BOUNDS.items() if bound in schema])


def _as_toml(value: Any) -> str:
    if value is None:
        return "omitted"
    if isinstance(value, Spec):
        return getattr(value, "kind", "table")
    if isinstance(value, tuple):
        return f"[{', '.join(map(_as_toml, value))}]"
    return json.dumps(value) if isinstance(value, str | bool) else str(value)


def explain_key(key: str) -> str:
    """Return the documentation of a key as text, or the keys at the root of a scenario for an empty key.

    For a word that is not a key, return the keys and kinds that match the word. Raises `ScenarioError` if nothing
    matches.
    """
    key = shorten(key)
    named = [step for step in re.sub(r"\[\d+\]", "", key).split(".") if not step.isdecimal()]
    if not key:
        return "\n".join(_keys_of("", places(Scenario(), [])))
    steps, chosen = _split_kinds(named)
    dotted, owners = ".".join(steps), _places(steps[:-1], chosen)
    owners = [place for place in owners if steps and steps[-1] in place.owner.model_fields]
    if not owners and len(steps) == 1 and (found := _holding(words := steps[0].split())):
        return "\n".join([_words(words), *found])
    if not owners and (metric := next((each for each in METRICS if named == ["metric", each.kind]), None)):
        return _metric_text(metric)
    if not owners:
        raise ScenarioError(f"{key}: unknown key{_nearest(key)}")
    if steps[-1] == "kind":
        return "\n".join([dotted, *_kinds_of(dotted.removesuffix(".kind"))])
    if len(steps) < len(named) and (table := chosen[-1])[0] == dotted:
        return _kind_text(table, _places(steps, chosen))
    if inner := _places(steps, chosen):
        text = document(owners[0], steps[-1]).text
        return "\n".join([dotted, *_indent(text), *_kinds_of(dotted), "", *_keys_of(dotted, inner)])
    docs: dict[Doc, list[TableClass]] = {}
    for place in owners:
        docs.setdefault(document(place, steps[-1]), []).append(place)
    return "\n\n".join("\n".join([dotted, *_doc_lines(doc, having)]) for doc, having in docs.items())


Chosen = list[tuple[str, str]]  # Pairs of the dotted key of a table and the kind selected for this table


def _split_kinds(named: list[str]) -> tuple[list[str], Chosen]:
    """Split a key into its names without kinds, and the kind of each table. For example, `fault.gnss_drift.start_s`
    gives `fault`, `start_s`, and the kind `gnss_drift` of the table `fault`."""
    steps, chosen = list[str](), Chosen()
    for name in named:
        table = ".".join(steps)
        if name in families().get(table, {}) and not any(name in p.owner.model_fields for p in _places(steps, chosen)):
            chosen.append((table, name))
        else:
            steps.append(name)
    return steps, chosen


def _places(steps: list[str], chosen: Chosen) -> list[TableClass]:
    """Return all possible classes of the table at the key path `steps`, if other tables have the kinds `chosen`."""
    tables = dict(chosen)
    return [
        place
        for place in places(Scenario(), steps)
        if all(tables.get(table, kind) == kind for table, kind in place.kinds)
    ]


def _kind_text(chosen: tuple[str, str], having: list[TableClass]) -> str:
    table, kind = chosen
    part = families()[table][kind]
    more = (inspect.getdoc(part) or "").partition("\n")[2]
    text = f"{first_line(part, kind)}\n{more}"
    return "\n".join([f"{table}.kind = {kind}", *_indent(text), "", *_keys_of(table, having)])


def _metric_text(metric: Metric) -> str:
    width = max((len(column.name) for column in metric.columns), default=0)
    values = [f"  {column.name:{width}}  {column.description} [{column.unit}]" for column in metric.columns]
    text = inspect.getdoc(type(metric)) or ""
    return "\n".join([f"metric {metric.kind}", *_indent(text), "", "values", *values])


def _holding(words: list[str]) -> list[str]:
    """Return one line per key or kind whose name matches the words. If no name matches, search the descriptions."""
    known = dict.fromkeys((key.dotted, key.owner, key.name) for key in keys(Scenario))
    if len("".join(words)) < SHORTEST_WORD:
        return []
    kinds = [row for row in known_kinds() if named_by(words, row.kind)]
    of_name = [each for each in known if named_by(words, each[2])]
    of_text = [each for each in known if not of_name and not kinds and named_by(words, each[1].describe(each[2]))]
    shown: dict[str, str] = {}
    for table, kind, text in kinds:
        shown.setdefault(f"{table}.{kind}", text)
    for dotted, owner, name in of_name or of_text:
        shown.setdefault(dotted, owner.describe(name).partition("\n")[0])
    width = max(map(len, shown), default=0)
    return [f"  {dotted:{width}}  {text}".rstrip() for dotted, text in shown.items()]


def _words(words: list[str]) -> str:
    others = list(dict.fromkeys(other for word in words for other in alternatives(word)[1:]))
    also = f" or {', '.join(map(repr, others))}" if others else ""
    return f"no key {' '.join(words)!r}; keys that contain it{also}"


def _indent(text: str) -> list[str]:
    return [f"  {line.strip()}" for line in text.splitlines() if line.strip()]


def _doc_lines(doc: Doc, having: list[TableClass]) -> list[str]:
    rows = {"unit": doc.unit, "value": doc.kind, "default": doc.default, "source": doc.source}
    lines = [*_indent(doc.text), *(f"  {name:8} {text}" for name, text in rows.items() if text)]
    chosen = dict.fromkeys(choice for place in having for choice in place.kinds)
    for table, known in families().items():
        kinds = [kind for where, kind in chosen if where == table]
        if kinds and len(kinds) < len(known):
            lines.append(f"  {'with':8} {table}.kind = {', '.join(kinds)}")
    return lines


def _kinds_of(table: str) -> list[str]:
    kinds, usual = families().get(table, {}), usual_kind(table)
    width = max(map(len, kinds), default=0)
    lines = [
        f"{'*' if kind == usual else ' '} {kind:{width}}  {first_line(part, kind)}" for kind, part in kinds.items()
    ]
    return ["", f"kinds{' (* default)' if usual else ''}", *lines] if kinds else []


def usual_kind(table: str) -> str | None:
    """Return the default kind of a table, or None for a list, whose items must each set `kind`."""
    *above, last = table.split(".")
    owners = (place for place in places(Scenario(), above) if last in place.owner.model_fields)
    found = (getattr(place.default, last, None) for place in owners)
    return next((kind for part in found if (kind := getattr(part, "kind", None))), None)


def _keys_of(table: str, having: list[TableClass]) -> list[str]:
    rows: dict[tuple[str, str], tuple[str, list[str]]] = {}
    for place in having:
        for name in place.owner.model_fields:
            if name != "kind":
                default, text = _in_short(place, name)
                kinds = rows.setdefault((name, default), (text, []))[1]
                kinds += [kind for where, kind in place.kinds if where == table]
    wide = [max((len(row[k]) for row in rows), default=0) for k in (0, 1)]
    most, lines = len({place.owner for place in having}), []
    for (name, default), (text, kinds) in rows.items():
        only = f" ({', '.join(dict.fromkeys(kinds))})" if kinds and len(set(kinds)) < most else ""
        lines.append(f"  {name:{wide[0]}}  {default:{wide[1]}}  {text}{only}".rstrip())
    return ["keys and defaults", *lines]


def _in_short(place: TableClass, name: str) -> tuple[str, str]:
    doc, parts = document(place, name), members(place.owner.model_fields[name].annotation)
    text = " ".join(doc.text.split())
    if not text and parts:
        text = first_line(next(iter(parts.values()))) if len(parts) == 1 else f"One of {', '.join(parts)}."
    return doc.default, text


def _nearest(key: str) -> str:

    def likeness(dotted: str) -> float:
        whole = SequenceMatcher(None, key, dotted).ratio()
        return max(whole, 0.8 * SequenceMatcher(None, key.rpartition(".")[2], dotted.rpartition(".")[2]).ratio())

    known = dict.fromkeys(key.dotted for key in keys(Scenario))
    near = sorted((dotted for dotted in known if likeness(dotted) > 0.65), key=likeness, reverse=True)[:3]
    if near:
        return f"; did you mean {' or '.join(map(repr, near))}?"
    return "; `agrobot-mj explain` lists the tables; a plugin's key needs --plugin FILE.py"


def json_schema() -> dict[str, Any]:
    """Return the JSON schema of a scenario file. A table without `kind` has its default kind, as in a loaded file."""
    schema = Scenario.model_json_schema()
    _drop_titles(schema)
    implied = {type(key.owner.model_fields[key.name].get_default()) for key in keys(Scenario)}
    names = {part.__name__ for part in implied}
    for name, part in schema["$defs"].items():  # names of classes with the same name are prefixed with their modules
        if "const" in part.get("properties", {}).get("kind", {}) and name.rpartition("__")[2] not in names:
            part.setdefault("required", []).append("kind")
    return {"$schema": "http://json-schema.org/draft-07/schema#", "title": "agrobot_mj scenario", **schema}


def _drop_titles(schema: Any) -> None:
    if isinstance(schema, list):
        for item in schema:
            _drop_titles(item)
    elif isinstance(schema, dict):
        if isinstance(schema.get("title"), str):
            del schema["title"]
        for name, inner in schema.items():
            for part in inner.values() if name in ("properties", "$defs") else [inner]:
                if name != "default":
                    _drop_titles(part)
