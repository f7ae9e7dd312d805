"""Tables of a comparison: plain text that is valid Markdown."""

from collections.abc import Mapping, Sequence
from typing import Any

from agrobot_mj.core.markdown import markdown_table
from agrobot_mj.metrics.success import error_of, failures, has_errors


def table(rows: Sequence[Mapping[str, Any]]) -> str:
    """The comparison as a plain text table, ASCII and valid Markdown, without a final newline.

    `rows` are those of `comparison.json`. `/ pd` is the lateral mean square error over that of the first law with `pd`
    on the same plant, variant, seed and piece of path; runs that failed have no errors (`metrics.success`). Variant,
    guidance, seed and piece have a column where they tell rows apart.
    """
    of_pd = [row for row in reversed(rows) if row["controller"] == "pd"]
    pd_mse = {_place(row): error_of(row, "lateral_mse") for row in of_pd}
    names = [name for name in ("plant", "variant", "guidance", "controller", "seed", "piece") if _tells(rows, name)]
    lines = [
        (
            *("-" if row.get(name) is None else row[name] for name in names),
            *(row.get("outcome", "-"), *_numbers(row, pd_mse.get(_place(row)))),
        )
        for row in rows
    ]
    heads = (*names, "outcome", "lateral MSE [m2]", "turn 1", "turn 2", "/ pd", "xte rms [m]", "nn 1", "nn 2")
    return markdown_table(heads, lines, len(names) + 1, aligned=True)


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
    shares = {number: share for number, share in enumerate(row.get("nn_share", []), 1) if number in whole}
    return [
        _text(mse, 4),
        *(_text(whole[k]["lateral_mse"], 4) if k in whole else "-" for k in (1, 2)),
        _text(mse / pd_mse if mse is not None and pd_mse else None, 2),
        _text(error_of(row, "xte_rms"), 3),
        *(_text(shares.get(k), 3) for k in (1, 2)),
    ]


def _text(value: float | None, decimals: int) -> str:
    if value is None:
        return "-"
    return f"{value:.{decimals}f}" if abs(value) < 1e4 else f"{value:.1e}"
