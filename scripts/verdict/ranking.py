"""Rank of each law on each ground, from two sets of seeds: what a second set confirms, and what it does not.

A law ranks behind those that fail less often, and of as many failures behind those that are better by more than chance:
the 95 % interval of the paired difference of the cross-track rms, seed by seed, excludes 0. So laws that no number of
these runs tells apart share a rank. Two sets of seeds contradict each other on a pair of laws if each tells them apart,
the other way round.
"""

import json
from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations
from math import isfinite
from typing import NamedTuple

from estimates import Row, by_seed, difference, estimate, field

from agrobot_mj.core.markdown import markdown_table

ByLaw = Mapping[str, Mapping[int, float]]
"""Cross-track rms [m] by law and seed, NaN of a run that failed."""


class Compared(NamedTuple):
    """Pairs of laws in two sets of seeds."""

    pairs: int
    """Number of pairs, all grounds together."""
    confirmed: int
    """Pairs told apart by both sets, the same way."""
    contradicted: int
    """Pairs told apart by both sets, the other way round."""
    undecided: int
    """Pairs that one set or both do not tell apart."""


def by_ground(rows: Sequence[Row]) -> dict[tuple[str, ...], dict[str, dict[int, float]]]:
    """Cross-track rms [m] of the runs of `controllers` by ground (tyre, terrain), law (variant) and seed."""
    found: dict[tuple[str, ...], dict[str, list[Row]]] = {}
    for row in rows:
        terrain = " ".join(str(value) for value in json.loads(row["terrain"]).values())
        found.setdefault((row["plant.tyre.kind"], terrain), {}).setdefault(row["variant"], []).append(row)
    return {
        ground: {law: by_seed(runs, field("xte_rms")) for law, runs in laws.items()} for ground, laws in found.items()
    }


def better(one: Mapping[int, float], other: Mapping[int, float]) -> bool:
    """Whether `one` fails less often than `other`, or as often and is less by more than chance, on common seeds."""
    seeds = one.keys() & other.keys()
    failed, others = (sum(not isfinite(values[seed]) for seed in seeds) for values in (one, other))
    if failed != others:
        return failed < others
    return difference(one, other).high < 0.0


def ranks(laws: ByLaw) -> dict[str, int]:
    """1 and the number of laws that are better, of each law."""
    return {law: 1 + sum(better(laws[rival], laws[law]) for rival in laws if rival != law) for law in laws}


def compare_sets(first: Mapping[tuple[str, ...], ByLaw], again: Mapping[tuple[str, ...], ByLaw]) -> Compared:
    """Every pair of laws on every ground that both sets have."""
    verdicts = [
        (_sign(first[ground], a, b), _sign(again[ground], a, b))
        for ground in first
        for a, b in _pairs(first[ground], again.get(ground, {}))
    ]
    products = [x * y for x, y in verdicts]
    return Compared(len(products), products.count(1), products.count(-1), products.count(0))


def compared_text(found: Compared) -> str:
    """What a second set of seeds says, in a sentence."""
    return (
        f"Of {found.pairs} pairs of laws (all grounds together) both sets tell {found.confirmed} apart in the same "
        f"order and {found.contradicted} in the opposite one; {found.undecided} are left open by one or both."
    )


def ranking_table(first: Mapping[tuple[str, ...], ByLaw], again: Mapping[tuple[str, ...], ByLaw]) -> str:
    """Markdown table: a law per row, a ground per column; mean cross-track rms [cm] and rank in both sets of seeds."""
    laws = list(dict.fromkeys(law for found in first.values() for law in found))
    ranked = {ground: (ranks(first[ground]), ranks(again[ground])) for ground in first}
    rows = []
    for law in laws:
        cells = []
        for ground in first:
            sets = zip((first, again), ranked[ground], strict=True)
            cells.append(" / ".join(_cell(found[ground], rank, law) for found, rank in sets))
        rows.append((law, *cells))
    return markdown_table(("law", *(", ".join(ground) for ground in first)), rows)


def _cell(laws: ByLaw, rank: Mapping[str, int], law: str) -> str:
    """Mean error [cm] and rank of a law."""
    return f"{estimate(laws[law].values()).short(1, 100)} ({rank[law]})" if law in rank else "-"


def _pairs(first: ByLaw, again: ByLaw) -> Iterator[tuple[str, str]]:
    return combinations([law for law in first if law in again], 2)


def _sign(laws: ByLaw, a: str, b: str) -> int:
    """1 if `a` is better than `b`, -1 if it is worse, 0 if they are not told apart."""
    return better(laws[a], laws[b]) - better(laws[b], laws[a])
