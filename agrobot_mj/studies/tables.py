"""Tables of a comparison: plain text that is valid Markdown."""

from collections.abc import Mapping, Sequence
from typing import Any

from agrobot_mj.core.markdown import markdown_table
from agrobot_mj.metrics.success import error_of, failures, has_errors

NONE = "-"
"""Cell without a value."""
MEANINGS = {
    "lateral MSE [m2]": "mean square of the error sideways, to the place where the reference is at that time",
    "turn 1": "the same in the first turn of the path",
    "turn 2": "the same in the second turn",
    "/ pd": "lateral MSE over that of pd, same plant, seed and field",
    "xte rms [m]": "root mean square distance from the path (cross-track error)",
    "nn 1": "share of the network in the steering command of the first turn",
    "nn 2": "the same in the second turn",
}
"""Numbers of the table by their heads, and what they mean."""


def table(rows: Sequence[Mapping[str, Any]]) -> str:
    """The comparison as a plain text table, ASCII and valid Markdown, without a final newline.

    `rows` are those of `comparison.json`. `/ pd` is the lateral mean square error over that of the first law with `pd`
    on the same plant, variant, seed and piece of path; runs that failed have no errors (`metrics.success`). Variant,
    guidance, seed and piece have a column where they tell rows apart, numbers where a row has one.
    """
    of_pd = [row for row in reversed(rows) if row["controller"] == "pd"]
    pd_mse = {_place(row): error_of(row, "lateral_mse") for row in of_pd}
    names = [name for name in ("plant", "variant", "guidance", "controller", "seed", "piece") if _tells(rows, name)]
    lines = [
        (
            *(NONE if row.get(name) is None else row[name] for name in names),
            *(row.get("outcome", NONE), *_numbers(row, pd_mse.get(_place(row)))),
        )
        for row in rows
    ]
    heads = (*names, "outcome", *MEANINGS)
    filled = [k for k, column in enumerate(zip(*lines, strict=True)) if k <= len(names) or set(column) != {NONE}]
    shown = [[line[k] for k in filled] for line in (heads, *lines)]
    return markdown_table(shown[0], shown[1:], len(names) + 1, aligned=True)


def legend(text: str) -> list[str]:
    """A line for each number in the heads of a `table`, with what it means."""
    heads = [head.strip() for head in text.partition("\n")[0].split("|")]
    shown = {head: meaning for head, meaning in MEANINGS.items() if head in heads}
    width = max(map(len, shown), default=0)
    return [f"{head:{width}}  {meaning}" for head, meaning in shown.items()]


def notes(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """Lines under the table: which runs failed and how, and whether errors can be compared at all."""
    laws: dict[str, list[Mapping[str, Any]]] = {}
    for row in rows:
        laws.setdefault(str(row["folder"]).removesuffix(f"-s{row['seed']}"), []).append(row)
    found = [f"{law}: failed {text}; no errors of these" for law, some in laws.items() if (text := failures(some))]
    if len({row.get("piece") for row in rows}) > 1:
        found.append("the runs cover different pieces of path (column piece): compare errors within one piece only")
    return found


def _tells(rows: Sequence[Mapping[str, Any]], name: str) -> bool:
    """Whether a column is shown: the plant and the controller always, others where they differ."""
    return name in ("plant", "controller") or len({row.get(name) for row in rows}) > 1


def _place(row: Mapping[str, Any]) -> tuple[Any, ...]:
    return row["plant"], row.get("variant"), row.get("seed"), row.get("piece")


def _numbers(row: Mapping[str, Any], pd_mse: float | None) -> list[str]:
    """Cells of a row of the table, from its mean square error on."""
    mse = error_of(row, "lateral_mse")
    turns = (row.get("per_turn") or []) if has_errors(row) else []
    whole = {turn["turn"]: turn for turn in turns if turn["complete"]}
    shares = {number: share for number, share in enumerate(row.get("nn_share", []), 1) if share and number in whole}
    return [
        _text(mse, 4),
        *(_text(whole[k]["lateral_mse"], 4) if k in whole else NONE for k in (1, 2)),
        _text(mse / pd_mse if mse is not None and pd_mse else None, 2),
        _text(error_of(row, "xte_rms"), 3),
        *(_text(shares.get(k), 3) for k in (1, 2)),
    ]


def _text(value: float | None, decimals: int) -> str:
    if value is None:
        return NONE
    return f"{value:.{decimals}f}" if abs(value) < 1e4 else f"{value:.1e}"
