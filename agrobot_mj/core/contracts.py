"""Checks of what methods of user-supplied kinds return: the type that their base asks for, or a message in words."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, TypeVar

from agrobot_mj.core.errors import ScenarioError, shortened

Message = TypeVar("Message")


@contextmanager
def without_exit() -> Iterator[None]:
    """Raise `ScenarioError` in place of the SystemExit that a plugin's code raises within the block."""
    try:
        yield
    except SystemExit as error:
        raise ScenarioError("code of the scenario's kinds has ended the run (SystemExit); let it raise") from error


def check_update(found: Any, message: type[Message], stage: str, kind: str, method: str) -> tuple[Any, Message]:
    """State and message that a method has returned. Raises `ScenarioError` for anything else."""
    if isinstance(found, tuple) and len(found) == 2 and isinstance(found[1], message):
        return found
    raise _refusal(found, f"its state and {_one(message)}", stage, kind, method)


def check_type(found: Any, wanted: type[Message], stage: str, kind: str, method: str) -> Message:
    """What a method has returned. Raises `ScenarioError` for another type."""
    if isinstance(found, wanted):
        return found
    raise _refusal(found, _one(wanted), stage, kind, method)


def check_pair(found: Any, wanted: str, stage: str, kind: str, method: str) -> tuple[Any, Any]:
    """A pair that a method has returned, `wanted` in words. Raises `ScenarioError` for anything else."""
    if isinstance(found, tuple) and len(found) == 2:
        return found
    raise _refusal(found, wanted, stage, kind, method)


def one_line(value: Any) -> str:
    """A value as a message shows it, in one line."""
    return shortened(" ".join(repr(value).split()))


def _one(message: type) -> str:
    return f"{'an' if message.__name__[0] in 'AEIOUaeiou' else 'a'} {message.__name__}"


def _refusal(found: Any, wanted: str, stage: str, kind: str, name: str) -> ScenarioError:
    return ScenarioError(f"{stage} ({kind}): {name} must return {wanted}, got {one_line(found)}")
