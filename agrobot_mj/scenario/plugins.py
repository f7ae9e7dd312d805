"""Registration of user-defined kinds: a law, tyre, path or fault becomes a member of the family of its base class.

`register` adds a class to the unions of the schema. The kind is then validated, overridden, listed and written to
`scenario.toml` like any other kind. Plugin code is loaded only by an explicit call, from `--plugin FILE.py` or from an
entry point of the group `agrobot_mj.plugins`. A scenario file cannot load code.
"""

import importlib.util
import inspect
import re
import shlex
import sys
import traceback
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from functools import cache
from importlib.abc import Loader
from importlib.machinery import ModuleSpec
from itertools import islice
from pathlib import Path
from types import ModuleType
from typing import Annotated, Any, TypeVar, Union, cast, get_args, get_origin

from pydantic import ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import PydanticSerializationError

from agrobot_mj.core.contracts import check_argument
from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.core.identity import digest, take_in, taking_in_imports
from agrobot_mj.core.resources import entry_points_of, is_file
from agrobot_mj.core.spec import Spec, members
from agrobot_mj.core.walk import Key, keys
from agrobot_mj.metrics import METRICS, Metric
from agrobot_mj.scenario.schema import Scenario, compact
from agrobot_mj.sensors import Sensor, Sensors

Member = TypeVar("Member", bound=type[Spec])
_files: dict[Path, ModuleType] = {}
RUN_WITH, NOTED_WITHIN = "# run with ", 5
"""Start of the comment that lists the plugin files, and number of lines at the top of a file that may contain it."""
WITHOUT = ": the scenario was run with plugins; add "
"""Text before the `--plugin` options in the message about missing plugins."""


def register(member: Member, name: str | None = None) -> Member:
    """Add a class to the family of its base class. Raises `ScenarioError` for unsuitable classes.

    The function can be used as a decorator. A sensor becomes the table `[sensors.NAME]`. The default name is the class
    name in lower case with underscores. A metric is evaluated in every run.
    """
    _rebuild(Scenario, _add_to_family(member, name), {})
    return member


def _add_to_family(member: type[Spec], name: str | None = None) -> set[type[Spec]]:
    """Add a class to its family, as `register` does, and return the classes whose validators must be rebuilt."""
    check_argument("member", member, isinstance(member, type), "a class")
    check_argument("name", name, name is None or isinstance(name, str), "a string")
    if not issubclass(member, Spec):
        raise ScenarioError(f"register: {member!r} is not derived from a base class of the package")
    if missing := _left_open(member):
        raise ScenarioError(
            f"register: {member.__name__}: the class lacks {', '.join(missing)}, required by its base class"
        )
    try:
        default = member.model_validate(dict(member()))  # pydantic does not validate defaults
    except ValidationError as error:
        keys = ", ".join(str(part["loc"][0]) for part in error.errors() if part["loc"])
        raise ScenarioError(f"register: {member.__name__}: every key needs a valid default ({keys})") from None
    try:
        default.model_dump_json()
    except PydanticSerializationError as error:
        raise ScenarioError(
            f"register: {member.__name__}: the class has a key that TOML cannot represent ({error})"
        ) from None
    changed = set[type[Spec]]()
    if issubclass(member, Sensor):
        changed = _add_sensor(name or re.sub(r"(?<!^)(?=[A-Z])", "_", member.__name__).lower(), member, default)
    elif isinstance(default, Metric):
        _add_metric(default)
    elif isinstance(registry := getattr(member, "registry", None), list):
        _add_listed(default, registry)
    else:
        changed = _add_kind(member)
    take_in(member.__module__, member)
    return changed


def _left_open(member: type[Spec]) -> list[str]:
    """Return the names of abstract methods and properties that a class lacks, or an empty list for a subclass of a
    kind."""
    bases = [base for base in member.__mro__[1:] if issubclass(base, Spec) and "kind" in base.model_fields]
    if any(isinstance(base.model_fields["kind"].default, str) for base in bases):
        return []
    found = []
    for name in dir(member):
        attribute = inspect.getattr_static(member, name)
        code = getattr(getattr(attribute, "fget", attribute), "__code__", None)
        if code is not None and "NotImplementedError" in code.co_names:
            found.append(name)
    return found


def _add_sensor(name: str, member: type[Spec], default: Spec) -> set[type[Spec]]:
    there = Sensors.model_fields.get(name)
    if there and not _same(there.annotation, member):
        raise _taken_error(f"sensors.{name}", there.annotation, f"another name for {member.__name__}")
    field = FieldInfo.from_annotated_attribute(member, default)
    field.description = inspect.getdoc(member)
    Sensors.model_fields[name] = field
    Sensors.model_rebuild(force=True)
    Scenario.model_fields["sensors"].default = Sensors()
    compact.cache_clear()
    return {Sensors}


def _add_metric(metric: Metric) -> None:
    others = [other for other in METRICS if not _same(type(other), type(metric))]
    for other in others:
        if taken := [other.kind] if other.kind == metric.kind else sorted(other.names & metric.names):
            raise _taken_error(f"metric {taken[0]!r}", type(other))
    METRICS[:] = [*others, metric]


def _add_listed(default: Any, registry: list[Any]) -> None:
    """Insert the object `default` at the front of the registry list of its family."""
    others = [other for other in registry if not _same(type(other), type(default))]
    for other in others:
        if other.kind == default.kind:
            raise _taken_error(f"kind {default.kind!r}", type(other))
    registry[:] = [default, *others]


def _add_kind(member: type[Spec]) -> set[type[Spec]]:
    field = member.model_fields.get("kind")
    kind = field.default if field and get_args(field.annotation) == (field.default,) else None
    if not isinstance(kind, str):
        raise ScenarioError(f'register: {member.__name__}: the class needs a kind: Literal["my_kind"] = "my_kind"')
    first, *nested = _family(member)
    # A law that contains another law must not contain a law of its own type.
    contains = any(key.owner is member or key.kinds.keys() & first.kinds.keys() for key in keys(member))
    family = [first] if contains else [first, *nested]
    for key in family:
        field = key.owner.model_fields[key.name]
        there = key.kinds.get(kind)
        if there and not _same(there, member):
            raise _taken_error(f"{family[0].dotted}.kind {kind!r}", there)
        field.annotation = _with_member(field.annotation, member, there)
    return {key.owner for key in family}


def _same(there: Any, member: type[Spec]) -> bool:
    """Return whether two classes have the same module and name, for example after a notebook cell was run again."""
    return (there.__module__, there.__qualname__) == (member.__module__, member.__qualname__)


def _taken_error(what: str, there: Any, choose: str = "another") -> ScenarioError:
    own = there.__module__.startswith("agrobot_mj.")
    file = None if own else getattr(sys.modules.get(there.__module__), "__file__", None)
    return ScenarioError(f"register: {what} already exists{f' in {file}' if file else ''}; choose {choose}")


def _family(member: type[Spec]) -> list[Key]:
    """Return the schema keys whose kinds belong to the same family as a class, shortest key first."""
    bases: dict[type, dict[Key, None]] = {}
    for key in keys(Scenario):
        for known in key.kinds.values():
            for base in known.__mro__[: known.__mro__.index(Spec)]:
                bases.setdefault(base, {})[key] = None
    for base in member.__mro__:
        family = sorted(bases.get(base, {}), key=lambda key: len(key.dotted))
        if family and all(f"{key.dotted}.".startswith(f"{family[0].dotted}.") for key in family):
            return family
    # The base class of a family declares `kind` as str; its members declare a Literal.
    public = [base.__name__ for base in bases if vars(base).get("__annotations__", {}).get("kind") is str]
    names = ", ".join(sorted([*public, Metric.__name__, Sensor.__name__]))
    raise ScenarioError(
        f"register: {member.__name__}: the class has no known base class; derive it from one of {names}"
    )


def _with_member(annotation: Any, member: type[Spec], instead: type[Spec] | None) -> Any:
    """Return the annotation with `member` added to its union. If `instead` is given, `member` replaces
    this older version."""
    if get_origin(annotation) is Annotated:
        union, *metadata = get_args(annotation)
        return Annotated[(_with_member(union, member, instead), *metadata)]
    if get_origin(annotation) is tuple:
        return tuple[_with_member(get_args(annotation)[0], member, instead), ...]  # type: ignore[misc]
    known = [other for other in get_args(annotation) or (annotation,) if other is not instead]
    return Union[(*known, member)]


def _rebuild(owner: type[Spec], changed: set[type[Spec]], seen: dict[type[Spec], bool]) -> bool:
    """Rebuild the validators of `owner` and of its nested classes that contain a class in `changed`. Return whether
    `owner` was rebuilt."""
    if owner not in seen:
        seen[owner] = False
        inner = [part for field in owner.model_fields.values() for part in members(field.annotation).values()]
        rebuilt = [_rebuild(part, changed, seen) for part in inner]
        seen[owner] = any(rebuilt) or owner in changed
        if seen[owner]:
            owner.model_rebuild(force=True)
    return seen[owner]


def load_plugins(paths: Iterable[Path]) -> None:
    """Load each plugin file once and register its classes. Raises `ScenarioError` for an invalid file."""
    for path in paths:
        if (file := path.resolve()) not in _files:
            with _naming(f"--plugin {path}"):
                _files[file] = _import_file(path)


def loaded_files() -> tuple[Path, ...]:
    """Return the plugin files loaded in this process. Worker processes must load the same files."""
    return tuple(_files)


def place_in_plugin(error: BaseException) -> str:
    """Return the innermost plugin line in the traceback of an error or of its cause, as ` (own.py, line 12)`.

    Returns an empty string if there is no plugin line.
    """
    files = set(map(str, _files))
    lines = [(frame.f_code.co_filename, line) for frame, line in traceback.walk_tb(error.__traceback__)]
    found = [f" ({Path(file).name}, line {line})" for file, line in lines if file in files]
    if found:
        return found[-1]
    return place_in_plugin(error.__cause__) if error.__cause__ else ""


def plugin_options(files: Iterable[Path] | None = None) -> str:
    """Return the `--plugin` options for plugin files, quoted for a shell. Default: the files loaded in this process."""
    return " ".join(f"--plugin {shlex.quote(str(path))}" for path in (loaded_files() if files is None else files))


def plugin_note() -> str:
    """Return the comment that lists the plugin files in the results of a run, or an empty string if there are none."""
    return f"{RUN_WITH}{options}\n" if (options := plugin_options()) else ""


def with_plugin_options(error: ScenarioError, file: Path) -> ScenarioError:
    """Return an error extended by `--plugin` options for plugins listed in `file` that this process has not loaded."""
    if WITHOUT in str(error) or not (absent := _absent(file)):
        return error
    return ScenarioError(f"{error}\n{file}{WITHOUT}{plugin_options(absent)}")


def _absent(file: Path) -> list[Path]:
    """Return the plugin files that the `plugin_note` in a file lists but that this process has not loaded."""
    if not is_file(file):  # reading a pipe would block
        return []
    try:
        with file.open(encoding="utf-8") as lines:
            note = next((line for line in islice(lines, NOTED_WITHIN) if line.startswith(RUN_WITH)), "")
        words = shlex.split(note.removeprefix(RUN_WITH))
    except (OSError, ValueError):
        return []
    return [path for word in words if word != "--plugin" and (path := Path(word)) not in _files]


@cache
def load_installed() -> None:
    """Register all kinds, sensors and metrics of extensions and installed plugins.

    Raises `ScenarioError` for an invalid plugin.
    """
    changed = set[type[Spec]]()
    for entry in entry_points_of("plugins"):
        with _naming(f"plugin {entry.name}{f' of {entry.dist.name}' if entry.dist else ''}"):
            with taking_in_imports():
                found = entry.load()
            take_in(entry.module)
            if not isinstance(found, tuple):
                found = _public_members([found] if inspect.isclass(found) else vars(found).values())
            for member in found:
                changed |= _add_to_family(member)
    _rebuild(Scenario, changed, {})  # once for all members, because a rebuild takes 50 ms


@contextmanager
def _naming(source: str) -> Iterator[None]:
    """Convert every error raised in the block to a `ScenarioError` whose message starts with `source`."""
    try:
        yield
    except ScenarioError as error:
        raise ScenarioError(f"{source}: {error}") from None
    except (Exception, SystemExit) as error:
        place = f"line {error.lineno}: " if isinstance(error, SyntaxError) else ""
        raise ScenarioError(f"{source}: {place}{type(error).__name__}: {error}") from error


def _import_file(path: Path) -> ModuleType:
    if not path.is_file() or path.suffix != ".py":
        raise ScenarioError(
            "the file is not a Python file (.py)" if path.exists() else "no such file; specify an existing file"
        )
    # The name contains a digest of the content, because files of the same name may differ. Copies are the same module.
    name = f"agrobot_mj_plugin_{path.stem}_{digest(path.read_bytes())}"
    spec = cast(ModuleSpec, importlib.util.spec_from_file_location(name, path))
    module = sys.modules[name] = importlib.util.module_from_spec(spec)
    # Python identifies bytecode by file size and whole seconds, so that a quick edit would import the old module.
    written, sys.dont_write_bytecode = sys.dont_write_bytecode, True
    try:
        with taking_in_imports():
            cast(Loader, spec.loader).exec_module(module)
    finally:
        sys.dont_write_bytecode = written
    take_in(name)
    for member in _public_members(vars(module).values()):
        register(member)
    return module


def _public_members(parts: Iterable[Any]) -> list[type[Spec]]:
    """Return the public sensor and component classes in `parts` that are defined outside the package."""
    specs = [part for part in parts if inspect.isclass(part) and issubclass(part, Spec)]
    own = [part for part in specs if not part.__name__.startswith("_")]
    own = [part for part in own if not part.__module__.startswith("agrobot_mj.")]
    kinds = [getattr(part.model_fields.get("kind"), "default", None) for part in own]
    return [part for part, kind in zip(own, kinds, strict=True) if issubclass(part, Sensor) or isinstance(kind, str)]
