"""Traversal of the configuration schema: all keys, and all possible classes of the table under a key.

Different kinds of a table may define the same key, so that a dotted key can belong to several classes (see `places`).
"""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from difflib import get_close_matches
from functools import lru_cache
from typing import NamedTuple

from agrobot_mj.core.spec import Spec, members

SYNONYMS = {
    "weight": ("mass",),
    "slope": ("grade",),
    "gradient": ("grade",),
    "incline": ("grade",),
    "angle": ("grade",),
    "gain": ("kp", "kd", "ki"),
    "velocity": ("speed",),
    "grip": ("mu",),
    "adhesion": ("mu",),
    "tire": ("tyre",),
    "gps": ("gnss",),
    "rtk": ("gnss",),
    "filter": ("estimator",),
    "law": ("guidance",),
    "lag": ("delay", "latency"),
    "delay": ("latency",),
    "noise": ("sigma",),
    "throttle": ("pedal",),
    "deadband": ("dead_band",),
    "zone": ("band",),
    "trailer": ("drawn", "hitch"),
    "plough": ("drawn", "draught"),
    "plow": ("drawn", "draught"),
    "mud": ("soil",),
    "heading": ("yaw",),
    "time": ("duration",),
}
"""Words that occur in the names of keys and kinds, keyed by synonyms that users may search for."""
SHORT = 3  # Maximum number of letters of a search word that matches complete words only, such as `mu`


def alternatives(word: str) -> tuple[str, ...]:
    """Return a word in lower case and its synonyms. A plural has the synonyms of its singular."""
    word = word.lower()
    return word, *SYNONYMS.get(word, SYNONYMS.get(word.removesuffix("s"), ()))


def named_by(words: list[str], text: str) -> bool:
    """Return whether `text` contains all search `words` joined together, or each word or at least one of its
    synonyms."""
    if "".join(words).lower() in re.sub(r"[\s_]", "", text.lower()):
        return True
    small = text.lower()
    parts = set(re.split(r"[^a-z0-9]+", small))  # only words longer than `SHORT` letters may be parts of other words
    return all(any(w in parts or (len(w) > SHORT and w in small) for w in alternatives(word)) for word in words)


def is_synonym(name: str, known: str) -> bool:
    """Return whether the name `known` starts with a synonym of the first word of `name`."""
    return any(f"{known}_".startswith(f"{other}_") for other in alternatives(name.partition("_")[0])[1:])


MOST_OFFERED = 2  # Maximum number of keys suggested in a message
NEAR_TABLES = 2  # Maximum depth of a key that is suggested only because it has the same name in another table
ALIKE = 0.65  # Minimum similarity of a suggested key name to the unknown name [-]. Assumed value.


class Key(NamedTuple):
    """Key of the configuration schema: its dotted name, the class that defines it, and the last part of the name."""

    dotted: str
    owner: type[Spec]
    name: str

    @property
    def kinds(self) -> Mapping[str, type[Spec]]:
        """Classes of the table under the key, by kind; empty if the key has no table or the table has no kinds."""
        tables = members(self.owner.model_fields[self.name].annotation)
        return tables if all("kind" in table.model_fields for table in tables.values()) else {}


class TableClass(NamedTuple):
    """Possible class of a configuration table, with the kinds that select this class and the default table."""

    kinds: tuple[tuple[str, str], ...]  # Kinds that select this class, as pairs (table, kind)
    owner: type[Spec]
    default: Spec


def keys(owner: type[Spec], prefix: str = "", above: tuple[type[Spec], ...] = ()) -> Iterator[Key]:
    """Yield all keys of the class `owner` and of its nested classes. A class that is nested in itself is visited
    once."""
    for name, field in owner.model_fields.items():
        yield Key(prefix + name, owner, name)
        for member in members(field.annotation).values():
            if member not in above:
                yield from keys(member, f"{prefix}{name}.", (*above, member))


class Index(NamedTuple):
    """Index of all keys of a configuration schema, in the order of traversal."""

    tables: dict[str, list[Key]]  # Keys by the name of their table
    names: dict[str, list[str]]  # Dotted keys by their last part, without duplicates


def index_of(root: type[Spec]) -> Index:
    """Return the index of all keys below `root`, cached until a plugin changes the schema."""
    return _key_index(root, root.__pydantic_validator__)


@lru_cache(maxsize=8)
def _key_index(root: type[Spec], _validator: object) -> Index:
    tables, names = dict[str, list[Key]](), dict[str, dict[str, None]]()
    for key in keys(root):
        tables.setdefault(key.dotted.rpartition(".")[0], []).append(key)
        names.setdefault(key.name, {})[key.dotted] = None
    return Index(tables, {name: list(found) for name, found in names.items()})


def elsewhere(root: type[Spec], name: str) -> str:
    """Return `; did you mean 'tractor.mass_kg'?` with the keys named `name` in any table, or "" if no table has this
    key."""
    return suggest(keys_named(root, name))


def keys_named(root: type[Spec], name: str, table: str = "") -> list[str]:
    """Return up to `MOST_OFFERED` dotted keys whose last part is `name`, keys in `table` first.

    Outside `table`, a name without an underscore is searched for only near the root of the schema.
    """
    found = index_of(root).names.get(name, [])
    inside = [dotted for dotted in found if table and dotted.startswith(f"{table}.")]
    others = [dotted for dotted in found if "_" in name or dotted.count(".") < NEAR_TABLES]
    return list(dict.fromkeys([*inside, *others]))[:MOST_OFFERED]


def nearest(root: type[Spec], dotted: str, owner: type[Spec] | None) -> str:
    """Return the end of the message for an unknown key in a table of class `owner`: a suggestion, or an empty string.

    Suggestions, in this order:

    1. the kind of the table that has this key,
    2. a key of the table whose name adds a unit or is similar in spelling or meaning, keys of `owner` first,
    3. the same name in another table.
    """
    table, _, name = dotted.rpartition(".")
    there = index_of(root).tables.get(table, [])
    if kinds := dict.fromkeys(_kind(key) for key in there if key.name == name and _kind(key)):
        return f"; it is a key of kind = {' or '.join(kinds)}"
    own = _like(name, owner.model_fields if owner else ())
    others = {key.name: _kind(key) for key in reversed(there)} if not own else {}
    near = own or [f"{key} (kind = {kind})" if (kind := others[key]) else key for key in _like(name, others)]
    if near and near[0].startswith(f"{name}_"):
        return suggest(near[:1])
    if own and is_synonym(name, own[0]):
        return suggest(own)
    return suggest(
        [*near[:1], *(key for key in keys_named(root, name, table) if not near or key.count(".") < NEAR_TABLES)]
    )


def suggest(found: Sequence[str]) -> str:
    """Return `; did you mean 'x' or 'y'?` with the first `MOST_OFFERED` keys of `found`, or "" if `found` is empty."""
    return f"; did you mean {' or '.join(map(_quote_key, found[:MOST_OFFERED]))}?" if found else ""


def _quote_key(text: str) -> str:
    key, blank, kind = text.partition(" ")
    return f"{key!r}{blank}{kind}"


def _kind(key: Key) -> str:
    kind = key.owner.model_fields.get("kind")
    return repr(kind.default) if kind and isinstance(kind.default, str) else ""


def _like(name: str, known: Iterable[str]) -> list[str]:
    """Return the names in `known` that are `name` with a unit, or else its synonyms, or else the most similar name."""
    known = list(known)
    if with_unit := [each for each in known if each.startswith(f"{name}_")]:
        return with_unit
    return [each for each in known if is_synonym(name, each)] or get_close_matches(name, known, 1, ALIKE)


def places(root: Spec, tables: Sequence[str]) -> list[TableClass]:
    """Return all possible classes of the table under the nested keys `tables` of `root`. The list may be empty."""
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
