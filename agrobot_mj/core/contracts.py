"""Checks of user-supplied values: arguments of the API, and return values of plugin methods.

A wrong argument type raises TypeError. A wrong return type raises `ScenarioError`.
"""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any, TypeVar

from agrobot_mj.core.errors import ScenarioError, shorten

Message = TypeVar("Message")


@contextmanager
def without_exit() -> Iterator[None]:
    """Convert a SystemExit or GeneratorExit that plugin code raises within the block to `ScenarioError`."""
    try:
        yield
    except (SystemExit, GeneratorExit) as error:
        name = type(error).__name__
        raise ScenarioError(f"code of a plugin ended the run with {name}; raise another exception") from error


def check_argument(name: str, value: object, fits: bool, wanted: str) -> None:
    """Raise TypeError for the argument `name` unless `fits` is true; the text `wanted` describes valid values."""
    if not fits:
        raise TypeError(f"{name}: must be {wanted}, got {one_line(value)}")


def check_overrides(overrides: object) -> None:
    """Raise TypeError unless `overrides` is a mapping with string keys."""
    fits = isinstance(overrides, Mapping) and all(isinstance(key, str) for key in overrides)
    check_argument("overrides", overrides, fits, "a mapping of dotted keys to values")


def check_update(found: Any, message: type[Message], stage: str, kind: str, method: str) -> tuple[Any, Message]:
    """Return the result `found` of a plugin method, a pair (state, `message` object). Raises `ScenarioError`
    otherwise."""
    if isinstance(found, tuple) and len(found) == 2 and isinstance(found[1], message):
        return found
    raise _refusal(found, f"its state and {_one(message)}", stage, kind, method)


def check_type(found: Any, wanted: type[Message], stage: str, kind: str, method: str) -> Message:
    """Return the result `found` of a plugin method. Raises `ScenarioError` unless `found` has the type `wanted`."""
    if isinstance(found, wanted):
        return found
    raise _refusal(found, _one(wanted), stage, kind, method)


def check_pair(found: Any, wanted: str, stage: str, kind: str, method: str) -> tuple[Any, Any]:
    """Return the result `found` of a plugin method, a pair. Raises `ScenarioError` with the text `wanted` otherwise."""
    if isinstance(found, tuple) and len(found) == 2:
        return found
    raise _refusal(found, wanted, stage, kind, method)


def is_compiled(part: Any, *methods: str) -> bool:
    """Return whether a simulation stage has compiled code and no subclass overrides the `methods` that this code
    replaces."""
    kinds = type(part).__mro__
    first = {name: next(k for k, kind in enumerate(kinds) if name in vars(kind)) for name in ("compiled", *methods)}
    return part.compiled is not None and first["compiled"] == min(first.values())


def one_line(value: Any) -> str:
    """Return the `repr` of a value on one line, shortened for a message."""
    return shorten(" ".join(repr(value).split()))


def _one(message: type) -> str:
    return f"{'an' if message.__name__[0] in 'AEIOUaeiou' else 'a'} {message.__name__}"


def _refusal(found: Any, wanted: str, stage: str, kind: str, name: str) -> ScenarioError:
    return ScenarioError(f"{stage} ({kind}): {name} must return {wanted}, got {one_line(found)}")
