"""Schema of sweep files: base scenario, axes, random samples, seeds and variants.

Axes, draws (random parameters), `set` and variants use dotted scenario keys, as `--set` does; each key is allowed once.
`portable` makes paths of data files relative to the sweep file, so that a results folder can be moved.
"""

import json
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from copy import deepcopy
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

from pydantic import BeforeValidator, Field, ValidationError, model_validator

from agrobot_mj.core.errors import ScenarioError, suggestion
from agrobot_mj.core.messages import fault, first_faults
from agrobot_mj.core.resources import sweep_files
from agrobot_mj.core.spec import Spec
from agrobot_mj.core.version import __version__
from agrobot_mj.scenario.loading import find_file, load_scenario, read_toml, scenario_files
from agrobot_mj.scenario.overrides import FILE_KEYS, absolute_value, explicit_values, json_text, relocate_files
from agrobot_mj.scenario.schema import Scenario
from agrobot_mj.studies.sweep.axes import DRAWS, AnyDraw, Axis, Choice, Listed

Seed = Annotated[int, Field(ge=0, le=2**63 - 1)]


MOST_SEEDS = 2**31


def _seeds(given: Any) -> Any:
    counted = isinstance(given, int) and 0 < given <= MOST_SEEDS
    if isinstance(given, bool) or not ((isinstance(given, list) and given) or counted):
        raise ValueError(f"must be a number of runs from 1 to {MOST_SEEDS:.2g}, or a list of seeds, got {given!r}")
    return tuple(given) if isinstance(given, list) else given


Seeds = Annotated[int | tuple[Seed, ...], BeforeValidator(_seeds)]


BASE = "base.toml"  # File name of the base scenario, in a folder with a resolved sweep
POINTS_PER_DRAW = 3
"""Minimum number of `screening` points per random parameter, sufficient for a regression with error estimates."""
SILENT = ("values", "int", "float", "tuple[constrained-int, ...]")
"""Parts of pydantic error locations that are not keys of a sweep file."""


class SweepVariant(Spec):
    """Named set of overrides in a sweep or comparison."""

    name: Annotated[str, Field(min_length=1)]
    """Name of the variant in tables and figures."""
    set: dict[str, Any] = Field(default_factory=dict)
    """Overrides by dotted key."""


class SweepFile(Spec):
    """Content of a sweep file."""

    base: str
    """Base scenario: a name, or a path relative to the folder of the sweep file."""
    title: str = ""
    """Title in lists and reports, on one line."""
    version: str = __version__
    """Version of agrobot_mj that wrote the file. The version does not affect the sweep."""
    seeds: Seeds = 1
    """Number of seeds, counted from the seed of the base scenario, or a list of seeds."""
    set: dict[str, Any] = Field(default_factory=dict)
    """Overrides of the base scenario that apply to all runs, by dotted key."""
    axes: dict[str, Axis] = Field(default_factory=dict)
    """Lists or ranges of values by dotted key. All combinations of the values are run."""
    draws: dict[str, AnyDraw] = Field(default_factory=dict)
    """Distributions of random parameters by dotted key."""
    samples: Annotated[int, Field(ge=1)] = 1
    """Number of random samples for each combination and seed."""
    method: Literal["random", "latin_hypercube", "sobol", "screening", "saltelli"] = "random"
    """Sampling method for the random parameters. `screening` and `saltelli` are designs for sensitivity analysis.

    `screening` is a Latin hypercube; `saltelli` has samples * (draws + 2) points. Both use the same points for all
    seeds, variants and axis values.
    """
    paired: bool = False
    """Whether all axis values and variants use the same samples, as required for comparisons between them."""
    draw_seed: Seed = 1
    """Seed of the random samples, independent of `seeds`."""
    variant: tuple[SweepVariant, ...] = ()
    """Named sets of overrides, each in a `[[variant]]` table, which can be combined with axes."""
    keep: Literal["table", "signals", "recordings", "failures"] = "table"
    """Files kept for each run in addition to its row.

    `table`: none; `signals`: signals; `recordings`: signals and recording; `failures`: signals and recording of failed
    runs.
    """

    @property
    def common(self) -> bool:
        """Whether all seeds, variants and axis values use the same samples."""
        return self.method in ("screening", "saltelli")

    @model_validator(mode="after")
    def _check_names(self) -> "SweepFile":
        if errors := list(self._clashes()):
            raise ValueError("\n".join(errors))
        return self

    def _copies(self) -> Iterator[str]:
        lists = {f"axes.{key}": axis.values for key, axis in self.axes.items() if isinstance(axis, Listed)}
        if isinstance(self.seeds, tuple):
            lists["seeds"] = self.seeds
        for name, values in lists.items():
            if twice := [text for text, count in Counter(map(_text, values)).items() if count > 1]:
                yield f"{name}: {', '.join(twice[:3])} is listed more than once; list each value once"
        for variant in self.variant:
            if "seed" in variant.set:
                yield f"variant {variant.name!r}: seed: has no effect; set seeds = [...] at the top level"

    def _clashes(self) -> list[str]:
        names = [variant.name for variant in self.variant]
        found = [
            f"variant: {names.count(n)} variants are named {n!r}; rename one"
            for n in dict.fromkeys(names)
            if names.count(n) > 1
        ]
        found += self._copies()
        for part, keys in (("axes", self.axes), ("draws", self.draws)):
            others = {"draws": self.draws} if part == "axes" else {}
            others |= {f"variant {variant.name!r}": variant.set for variant in self.variant}
            found += [
                f"{part}.{key}: the key is also in {other}; specify it once"
                for other, o in others.items()
                for key in keys
                if key in o
            ]
            if "seed" in keys:
                found.append(f"{part}.seed: has no effect; set seeds = [...] at the top level")
        if self.method == "saltelli" and self.samples & (self.samples - 1):
            found.append(f"samples: must be a power of two with saltelli, got {self.samples}")
        if self.method == "screening":
            found += self._unfit_for_screening()
        if not self.draws and "samples" in self.model_fields_set and self.samples > 1:
            found.append("samples: no parameter is drawn; add [draws], or repeat runs with seeds")
        return found

    def _unfit_for_screening(self) -> Iterator[str]:
        if self.samples < (least := POINTS_PER_DRAW * len(self.draws)):
            yield f"samples: must be at least {least} with screening, {POINTS_PER_DRAW} per draw, got {self.samples}"
        for key, draw in self.draws.items():
            values = draw.choice if isinstance(draw, Choice) else ()
            if any(isinstance(value, bool) or not isinstance(value, int | float) for value in values):
                yield f'draws.{key}: screening needs numbers; make it an axis, or set method = "saltelli"'


def _text(value: Any) -> str:
    """Return a value as text. Equal values, such as 1 and 1.0, have the same text."""
    whole = isinstance(value, float) and value.is_integer()
    return json.dumps(int(value) if whole else value, sort_keys=True, default=str)


class Sweep(NamedTuple):
    """Sweep file with its base scenario."""

    name: str
    file: SweepFile  # Content of the sweep file, with absolute paths
    base: Scenario  # Base scenario with the overrides of the table `set`

    @property
    def seeds(self) -> tuple[int, ...] | range:
        """Seeds with which each combination is run."""
        given = self.file.seeds
        return range(self.base.seed, self.base.seed + given) if isinstance(given, int) else given


def find_sweep(source: str | Path) -> Path:
    """Return the path of a sweep file, given by name or path. Raise `ScenarioError` if the file does not exist."""
    return find_file(source, "sweep", sweep_files(), ", or use --merge", "see agrobot-mj list --sweeps")


def read_sweep(source: str | Path) -> Sweep:
    """Return the sweep defined by a file. Raise a `ScenarioError` that lists all errors of the file."""
    path = find_sweep(source)
    data, folder = read_toml(path), path.parent.resolve()
    if not isinstance(data.get("base"), str):
        raise ScenarioError(f'{path.name}: base: the key is missing; specify a scenario, e.g. base = "side_slope"')
    try:
        file = SweepFile.model_validate_json(json_text(data, path.name))
    except ValidationError as error:
        raise ScenarioError("\n".join(_lines(path.name, error))) from None
    beside = folder / file.base
    source = beside if file.base not in scenario_files() and beside.is_file() else file.base
    file = _with_absolute_paths(file, folder)
    try:
        base = load_scenario(source, file.set)
    except ScenarioError as error:
        raise ScenarioError("\n".join(f"{path.name}: base: {line}" for line in str(error).splitlines())) from None
    return Sweep(path.name, file, base)


def _with_absolute_paths(file: SweepFile, folder: Path) -> SweepFile:
    """Return a copy of a sweep file with absolute paths. Relative paths refer to the folder of the sweep file."""
    data = _as_table(file)
    for key, axis in file.axes.items():  # only listed axes are expanded; other axes may have too many values
        data["axes"][key] = list(axis.values) if isinstance(axis, Listed) else axis.model_dump(by_alias=True)
    changed = changed_values(data, lambda key, value: absolute_value(key, value, Path.cwd(), folder))
    return SweepFile.model_validate_json(json.dumps(changed))


def changed_values(table: dict[str, Any], change: Callable[[str, Any], Any]) -> dict[str, Any]:
    """Return the content of a sweep file, with each value replaced by `change(key, value)`."""

    def each(values: Mapping[str, Any]) -> dict[str, Any]:
        return {key: change(key, value) for key, value in values.items()}

    def listed(key: str, values: Any) -> Any:
        return [change(key, value) for value in values] if isinstance(values, list) else values

    choices = {key: {name: listed(key, part) for name, part in draw.items()} for key, draw in table["draws"].items()}
    return {
        **table,
        "set": each(table["set"]),
        "axes": {key: listed(key, values) for key, values in table["axes"].items()},
        "draws": choices,
        "variant": [{**variant, "set": each(variant["set"])} for variant in table["variant"]],
    }


def last(key: str) -> str:
    """Return the last name of a dotted key, for example `kind` for `plant.kind`."""
    return key.rpartition(".")[2]


def _as_table(file: SweepFile) -> dict[str, Any]:
    data = file.model_dump(mode="json", exclude={"axes", "draws"})
    return {**data, "axes": {}, "draws": {key: draw.written for key, draw in file.draws.items()}}


def resolve_sweep(sweep: Sweep) -> dict[str, Any]:
    """Return the content of a sweep file for use with `base.toml`, which already contains the overrides `set`."""
    axes = {key: axis.written for key, axis in sweep.file.axes.items()}
    known = {"base": BASE, "set": {}, "seeds": list(sweep.seeds), "axes": axes, "version": __version__}
    return {**_as_table(sweep.file), **known}


def _lines(source: str, error: ValidationError) -> list[str]:
    found = []
    errors, more = first_faults(error)
    for each in errors:
        keys, kind = list(each["loc"]), each["type"]
        if len(keys) > 2 and keys[0] in ("axes", "draws"):
            del keys[2]  # tag of the discriminated union
        keys = ["from" if key == "start" else "to" if key == "stop" else key for key in keys if key not in SILENT]
        text = fault(each)
        if kind == "extra_forbidden":
            known = sorted(SweepVariant.model_fields if keys[0] == "variant" else SweepFile.model_fields)
            known = {"axes": ["count", "from", "step", "to"], "draws": [*DRAWS, "within"]}.get(str(keys[0]), known)
            text = f"unknown key{suggestion(str(keys[-1]), known)} (known: {', '.join(known)})"
        elif kind == "union_tag_invalid":
            text = f"is not a distribution; write one of {', '.join(f'{tag} = [...]' for tag in DRAWS)}"
        elif kind == "too_short" and keys[0] == "axes":
            text = "has no values; list at least one, or omit the axis"
        elif kind.startswith("model") and keys[0] == "axes":
            text = f"must be a list or a table {{ from, to, count }} or {{ from, to, step }}, got {each['input']!r}"
        key = ".".join(str(key) for key in keys)
        found += [f"{source}: {key}: {line}" if key else f"{source}: {line}" for line in text.splitlines()]
    return [*dict.fromkeys(found), *(f"{source}: {text}" for text in more)]


class PortableSweep(NamedTuple):
    """Contents of `sweep.toml` and `base.toml`, and the data files used in them."""

    sweep: dict[str, Any]  # Content of the sweep file, as returned by `resolve_sweep`
    base: dict[str, Any]
    files: dict[str, Path]  # Original paths of the data files, by file name in the folder

    @property
    def names(self) -> dict[str, str]:
        """Names of the data files in the folder, by original path."""
        return {str(path): name for name, path in self.files.items()}


def portable(sweep: Sweep) -> PortableSweep:
    """Return a sweep with names of data files in place of paths. Files of the package keep their names."""
    content, base, tables = resolve_sweep(sweep), explicit_values(sweep.base), list[dict[str, Any]]()
    changed_values(content, lambda key, value: tables.append({last(key): deepcopy(value)}))
    files = relocate_files([base, *tables])
    names = {str(path): name for name, path in files.items()}
    return PortableSweep(changed_values(content, lambda key, value: rename_files(key, value, names)), base, files)


def rename_files(key: str, value: Any, names: Mapping[str, str]) -> Any:
    """Return the value of a dotted key with paths of data files replaced by names."""
    if isinstance(value, str):
        return names.get(value, value) if last(key) in FILE_KEYS else value
    if isinstance(value, Mapping):
        return {inner: rename_files(inner, each, names) for inner, each in value.items()}
    return [rename_files("", each, names) for each in value] if isinstance(value, list | tuple) else value
