"""The walk through the schema: every key there is, and every class that the table under a key may be of.

The kinds of a part may share a key, so that a dotted key can belong to several classes: its `places`.
"""

from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

from agrobot_mj.core.spec import Spec, members

MOST_OFFERED = 2
"""Keys of a name that a message offers."""


class Key(NamedTuple):
    """A key of the schema."""

    dotted: str
    owner: type[Spec]
    """Class that defines the key."""
    name: str
    """Name of the key within its table."""

    @property
    def kinds(self) -> dict[str, type[Spec]]:
        """The classes of its table by their kind; empty where it holds nothing that comes in kinds."""
        tables = members(self.owner.model_fields[self.name].annotation)
        return tables if all("kind" in table.model_fields for table in tables.values()) else {}


class TableClass(NamedTuple):
    """A class that a table may be of."""

    kinds: tuple[tuple[str, str], ...]
    """(table, kind) of every choice that leads here."""
    owner: type[Spec]
    default: Spec


def keys(owner: type[Spec], prefix: str = "", above: tuple[type[Spec], ...] = ()) -> Iterator[Key]:
    """Every key from `owner` down; a recursive class is entered once."""
    for name, field in owner.model_fields.items():
        yield Key(prefix + name, owner, name)
        for member in members(field.annotation).values():
            if member not in above:
                yield from keys(member, f"{prefix}{name}.", (*above, member))


def elsewhere(root: type[Spec], name: str, here: str = "") -> str:
    """`; did you mean 'tractor.mass_kg'?`: the first keys of this very name in any table, or nothing.

    Where the dotted key `here` is one of another kind of its table, that kind instead.
    """
    named = [key for key in keys(root) if key.name == name]
    fields = [key.owner.model_fields for key in named if key.dotted == here]
    if kinds := list(dict.fromkeys(repr(each["kind"].default) for each in fields if "kind" in each)):
        return f"; it belongs to kind = {' or '.join(kinds)}"
    found = list(dict.fromkeys(repr(key.dotted) for key in named))
    return f"; did you mean {' or '.join(found[:MOST_OFFERED])}?" if found else ""


def places(root: Spec, tables: Sequence[str]) -> list[TableClass]:
    """Every class that the table under these keys of `root` may be of; empty where there is no such table."""
    found = [TableClass((), type(root), root)]
    for depth, name in enumerate(tables):
        found = [inner for place in found for inner in _inside(place, name, ".".join(tables[: depth + 1]))]
    return found


def _inside(place: TableClass, name: str, table: str) -> Iterable[TableClass]:
    if name not in place.owner.model_fields:
        return
    given = getattr(place.default, name, None)
    for kind, owner in members(place.owner.model_fields[name].annotation).items():
        chosen = (*place.kinds, (table, kind)) if "kind" in owner.model_fields else place.kinds
        yield TableClass(chosen, owner, given if type(given) is owner else owner.model_construct())
