"""The table of the sweep `ablation`: each variant of the network over the network as printed, seed by seed."""

from collections.abc import Callable, Sequence

from agrobot_mj.studies.verdict.claims import PLANTS
from agrobot_mj.studies.verdict.rows import ResultRow, select
from agrobot_mj.studies.verdict.statistics import by_seed, estimate, ratio

PRINTED = "as printed"
"""Variant with which the others are compared."""


def ablation_table(rows: Sequence[ResultRow]) -> str:
    """Markdown table: lateral mean square error of both turns, and of the whole over that of the network as printed."""
    head = [f"{plant}: {what}" for plant in PLANTS for what in ("turn 1 [m2]", "turn 2 [m2]", "over as printed")]
    lines = ["| variant | " + " | ".join(head) + " |", "|---|" + "---:|" * len(head)]
    for variant in dict.fromkeys(row["variant"] for row in rows):
        cells = [text for plant in PLANTS for text in _cells([r for r in rows if r["plant.kind"] == plant], variant)]
        lines.append(f"| {variant} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def _cells(rows: Sequence[ResultRow], variant: str) -> list[str]:
    """Both turns and the ratio of a variant on one plant."""
    runs, printed = select(rows, variant=variant), select(rows, variant=PRINTED)
    turns = [estimate(by_seed(runs, _of_turn(k)).values()) for k in (0, 1)]
    return [*(turn.short(4) for turn in turns), ratio(runs, printed, _mse).text() if variant != PRINTED else "1"]


def _mse(row: ResultRow) -> float:
    return float(row["lateral_mse"])


def _of_turn(k: int) -> Callable[[ResultRow], float]:
    """The error of a turn, counted from 0."""
    return lambda row: float(row["per_turn"][k]["lateral_mse"])
