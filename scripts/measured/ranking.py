"""Rank of each guidance law on each ground, from two independent sets of seeds.

A law ranks below laws that fail less often. Among laws with equal failures, a law ranks below laws that are
significantly better: the 95 % interval of the paired difference of the cross-track RMS excludes 0. Other laws share a
rank. The sets of seeds contradict each other on a pair of laws if both differences are significant with opposite signs.
"""

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from itertools import combinations
from math import isfinite

from estimates import BySeed, Columns, by_law, difference, estimate, field
from sweeps import Blocks, Row, Study

from agrobot_mj.core.markdown import markdown_table

AGAIN = list(range(21, 41))  # Seeds of the second set of runs of the sweep `controllers`
SAME, OPPOSITE, OPEN = 1, -1, 0
"""Results of comparing two sets of seeds for a pair of laws: same order, opposite order, or not significant."""


def ranking(study: Study) -> Blocks:
    """Return the table of ranks of the laws in the sweep `controllers`, and a text that compares both sets of seeds."""
    sets = [study.rows("controllers"), study.rows("controllers_again", "controllers", seeds=AGAIN)]
    if not all(sets):
        return {}
    first, again = map(by_ground, sets)
    return {"ranking": ranking_table(first, again), "ranked": compared_text(compare_sets(first, again))}


def by_ground(rows: Sequence[Row]) -> dict[str, dict[str, dict[int, float]]]:
    """Return the cross-track RMS in the sweep `controllers` [cm], by ground (tyre, terrain), by law and by seed."""
    found: dict[str, list[Row]] = {}
    for row in rows:
        terrain = " ".join(str(value) for value in json.loads(row["terrain"]).values())
        found.setdefault(f"{row['plant.tyre.kind']}, {terrain}", []).append(row)
    return {ground: by_law(runs, field("xte_rms", 100)) for ground, runs in found.items()}


def better(one: BySeed, other: BySeed) -> bool:
    """Return whether `one` fails less often than `other`, or equally often with a significantly smaller error."""
    seeds = one.keys() & other.keys()
    failed, others = (sum(not isfinite(values[seed]) for seed in seeds) for values in (one, other))
    if failed != others:
        return failed < others
    return difference(one, other).high < 0.0


def ranks(laws: Mapping[str, BySeed]) -> dict[str, int]:
    """Return the rank of each law: 1 plus the number of better laws."""
    return {law: 1 + sum(better(laws[rival], laws[law]) for rival in laws if rival != law) for law in laws}


def compare_sets(first: Columns, again: Columns) -> Counter[int]:
    """Return the number of pairs of laws with the result `SAME`, `OPPOSITE` and `OPEN`, summed over the grounds."""
    return Counter(
        _sign(first[ground], *pair) * _sign(again[ground], *pair)
        for ground in first.keys() & again.keys()
        for pair in combinations(first[ground].keys() & again[ground].keys(), 2)
    )


def compared_text(found: Counter[int]) -> str:
    """Return a sentence that summarises the agreement between the two sets of seeds."""
    return (
        f"Of {found.total()} pairs of laws (all terrains together) both sets rank {found[SAME]} in the same order "
        f"and {found[OPPOSITE]} in the opposite order; for {found[OPEN]} at least one set is inconclusive."
    )


def ranking_table(first: Columns, again: Columns) -> str:
    """Return a Markdown table by law and ground: mean cross-track RMS [cm] and rank in each set of seeds."""
    ranked = {ground: [(found[ground], ranks(found[ground])) for found in (first, again)] for ground in first}
    laws = dict.fromkeys(law for found in first.values() for law in found)
    rows = [(law, *(" / ".join(_cell(*each, law) for each in sets) for sets in ranked.values())) for law in laws]
    return markdown_table(("law", *first), rows)


def _cell(laws: Mapping[str, BySeed], rank: Mapping[str, int], law: str) -> str:
    """Return a table cell with the mean error [cm] and the rank of a law."""
    return f"{estimate(laws[law].values()).short(1)} ({rank[law]})" if law in rank else "-"


def _sign(laws: Mapping[str, BySeed], a: str, b: str) -> int:
    """Return 1 if law `a` is better than law `b`, -1 if `a` is worse, 0 if the difference is not significant."""
    return better(laws[a], laws[b]) - better(laws[b], laws[a])
