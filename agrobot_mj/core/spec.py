"""Base class of all configuration classes, which are frozen and accept only known keys and finite numbers.

pydantic can collect attribute docstrings when a class is created, which takes a quarter of a second in every run. Only
`explain`, `schema`, `init` and the docs use these docstrings. This module therefore reads them from the source on
demand.
"""

import ast
import inspect
import re
import sys
from collections.abc import Callable, Iterator, Mapping
from functools import cache, lru_cache
from itertools import pairwise
from math import inf, isclose, isfinite, prod
from operator import attrgetter
from typing import Annotated, Any, ClassVar, NamedTuple, Self, get_args

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, GetJsonSchemaHandler
from pydantic.fields import FieldInfo
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema

from agrobot_mj.core.errors import shorten
from agrobot_mj.core.signals import TICK_S


@cache
def attribute_docstrings(owner: type) -> dict[str, str]:
    """Return the attribute docstrings of a class and its bases, or an empty mapping if there is no source code."""
    found: dict[str, str] = {}
    for base in reversed(owner.__mro__):
        found.update(_own(base))
    return found


def _own(owner: type) -> dict[str, str]:
    body: list[ast.stmt] = list(_statements(owner.__module__))
    for name in owner.__qualname__.replace("<locals>.", "").split("."):
        inside = next((node for node in _definitions(body) if node.name == name), None)
        body = inside.body if inside else []
    return {
        before.target.id: inspect.cleandoc(after.value.value)
        for before, after in pairwise(body)
        if isinstance(before, ast.AnnAssign) and isinstance(before.target, ast.Name)
        if isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant) and isinstance(after.value.value, str)
    }


def _definitions(body: list[ast.stmt]) -> Iterator[ast.ClassDef | ast.FunctionDef]:
    for statement in body:
        if isinstance(statement, ast.ClassDef | ast.FunctionDef):
            yield statement
        else:
            yield from _definitions([node for node in ast.iter_child_nodes(statement) if isinstance(node, ast.stmt)])


@cache
def _statements(module: str) -> tuple[ast.stmt, ...]:
    try:
        return tuple(ast.parse(inspect.getsource(sys.modules[module])).body)
    except (KeyError, OSError, TypeError, SyntaxError):
        return ()


HUGE = 1e9  # Upper limit of all quantities, in the unit of the key; larger values would overflow
Positive = Annotated[float, Field(gt=0, le=HUGE)]
NonNegative = Annotated[float, Field(ge=0, le=HUGE)]
Scale = Annotated[float, Field(ge=1e-3, le=10)]  # Factor on a nominal value [-]
Spread = Annotated[float, Field(ge=0, le=10)]  # Standard deviation divided by the mean [-]
Fraction = Annotated[float, Field(ge=0, le=1)]
CarcassShare = Annotated[float, Field(ge=0.05, le=2)]
"""Stiffness of a tyre carcass divided by the vertical stiffness of the tyre [-]."""


class Discrete(NamedTuple):
    """Annotation of a configuration key that accepts only certain numbers within its limits."""

    nearest: Callable[[float], float]
    """Function that returns the accepted value nearest to a number within the limits."""


def nearest_tick(seconds: float) -> float:
    """Return the time [s] nearest to `seconds` that is a whole number of ticks."""
    return round(seconds / TICK_S) * TICK_S


def whole_ticks(seconds: float) -> float:
    """Return the time `seconds` unchanged. Raises ValueError unless the time is a whole number of ticks."""
    nearest = nearest_tick(seconds)
    if not isclose(seconds, nearest, abs_tol=1e-9):
        raise ValueError(f"{seconds} is not a multiple of the {TICK_S} s tick; try {nearest:g}")
    return seconds


UNPRINTABLE = re.compile("[\x00-\x1f\x7f-\x9f\u2028-\u202e\u2066-\u2069\ud800-\udfff]")
"""Pattern of control characters, separators, bidirectional marks and lone surrogates, which corrupt terminal output."""


def printable(text: str) -> str:
    """Return `text` unchanged. Raises ValueError for characters that control a terminal or reverse text."""
    if UNPRINTABLE.search(text):
        raise ValueError(f"must be one line of printable characters, got {shorten(repr(text))}")
    return text


SOFTEST_KPA, FIRMEST_KPA = 50.0, 5000.0
"""Minimum and maximum accepted cone index of a soil [kPa]. Assumed values: tyre data cover about 200-2000 kPa; a
tractor gets stuck on much softer soil, and much firmer ground is a road."""


def cone_index_in_range(kpa: float) -> float:
    """Return the cone index `kpa` [kPa] unchanged. Raises ValueError outside SOFTEST_KPA to FIRMEST_KPA."""
    if not SOFTEST_KPA <= kpa <= FIRMEST_KPA:
        fits = "the soil model is valid"
        raise ValueError(f"must be from {SOFTEST_KPA:g} to {FIRMEST_KPA:g} kPa, the range in which {fits}, got {kpa:g}")
    return kpa


ConeIndex = Annotated[float, Field(gt=0, le=HUGE), AfterValidator(cone_index_in_range)]
Latency = Annotated[float, Field(ge=0, le=5), AfterValidator(whole_ticks), Discrete(nearest_tick)]
"""Delay [s], a whole number of ticks."""


class Spec(BaseModel):
    """Base class of configuration classes, which are frozen, have units in the key names and reject unknown keys."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, strict=True, defer_build=True)

    sized: ClassVar[Mapping[str, Mapping[str, float]]] = {}
    """Exponents of the size ratios (`machine.fitting.ratios_of`) that scale default values, by dotted key."""

    def following(self, ratios: Mapping[str, float]) -> Self:
        """Return a copy whose default values are scaled by the size `ratios` of a machine, also in nested tables."""
        parts = {name: part for name in type(self).model_fields if isinstance(part := getattr(self, name), Spec)}
        found = self.model_copy()
        found.__dict__.update({name: part.following(ratios) for name, part in parts.items()})
        for key, powers in self.sized.items():
            name, _, inner = key.partition(".")
            field = type(self).model_fields[name]
            factor = prod(ratios[measure] ** power for measure, power in powers.items())
            value = factor * (attrgetter(inner)(field.default) if inner else field.default)
            low, high = _limits(field)
            fill(found, key.split("."), min(max(value, low), high))
        return found

    @classmethod
    def describe(cls, key: str) -> str:
        """Return the printable description of a key: by default its docstring, or an empty string if there is none."""
        text = cls.model_fields[key].description or attribute_docstrings(cls).get(key, "")
        return "\n".join(UNPRINTABLE.sub("", line) for line in text.split("\n"))

    @classmethod
    def __get_pydantic_json_schema__(cls, schema: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        found = handler(schema)
        for key, part in handler.resolve_ref_schema(found).get("properties", {}).items():
            if "description" not in part and (text := cls.describe(key)):
                part["description"] = text
        return found


def fill(part: Spec, keys: list[str], value: Any, default: bool = False) -> None:
    """Set a key to a default value unless the user has set the key; the key is not marked as set by the user."""
    name, *rest = keys
    default = default or name not in part.model_fields_set
    if rest:
        inner = getattr(part, name).model_copy()  # instances share their defaults
        fill(inner, rest, value, default)
        part.__dict__[name] = inner
    elif default:
        part.__dict__[name] = value


def _limits(field: FieldInfo) -> tuple[float, float]:
    """Return the minimum and the maximum of the numbers that a key accepts, by default -infinity and `HUGE`."""
    low, high = ([getattr(m, end) for m in field.metadata if hasattr(m, end)] for end in ("ge", "le"))
    return low[0] if low else -inf, high[0] if high else HUGE


def nearest_value(owner: type[Spec], key: str, value: float) -> float:
    """Return the number nearest to `value` that an integer or `Discrete` key of the class `owner` accepts.

    For other keys, `value` is rounded to ten digits. Values beyond the limits of a `Discrete` key remain invalid.
    """
    if (field := owner.model_fields.get(key)) is not None:
        kinds, (low, high) = _nested_types(field.annotation), _limits(field)
        if int in kinds and float not in kinds and isfinite(value):
            return round(value)
        for part in field.metadata:
            if isinstance(part, Discrete) and low <= value <= high:
                value = part.nearest(value)
    return float(f"{value:.10g}")


def _nested_types(annotation: Any) -> list[Any]:
    """Return a list of an annotation and all its nested arguments, for example the types of a union."""
    return [annotation, *(part for argument in get_args(annotation) for part in _nested_types(argument))]


def members(annotation: Any) -> Mapping[str, type[Spec]]:
    """Return the configuration classes in a type annotation by `kind`, or by class name if a class has no kind."""
    return _members(annotation)


@lru_cache(maxsize=4096)  # a search of the schema asks for the same annotations thousands of times
def _members(annotation: Any) -> Mapping[str, type[Spec]]:
    if isinstance(annotation, type) and issubclass(annotation, Spec):
        kind = annotation.model_fields.get("kind")
        return dict.fromkeys(
            get_args(kind.annotation) or [str(kind.default)] if kind else [annotation.__name__], annotation
        )
    found: dict[str, type[Spec]] = {}
    for argument in get_args(annotation):
        found.update(_members(argument))
    return found


def every(union: Any) -> list[type[Spec]]:
    """Return the classes of a union such as `Path`, one for each kind of a configuration table."""
    return list(dict.fromkeys(members(union).values()))
