"""docs/verdict.md: the paper's claims judged, how much each law survives, ablation, validity and importance.

Every part keeps its runs under runs/verdict and does what is missing there, so that it can be broken off at any time;
`--only-draw` writes page and figures from what is there, `--part NAME` does one part: a sweep, `survival`, `validity`.
"""

import shutil
from collections.abc import Sequence

from estimates import field, mean, ratio, select
from sweeps import Row, Study
from verdict import claims, figures, judgement, ranking, survival, validity

from agrobot_mj.core.markdown import markdown_table
from agrobot_mj.studies.style import save
from agrobot_mj.studies.sweep.importance import importance, importance_table, importance_text

PRINTED = "as printed"
"""Variant of the sweep `ablation` with which the others are compared."""
AGAIN = list(range(21, 41))
"""Seeds of the second set of `controllers`."""


def ablation_table(rows: Sequence[Row]) -> str:
    """Lateral mean square error of both turns, and of the whole over that of the network as printed."""
    lines = []
    for variant in dict.fromkeys(row["variant"] for row in rows):
        cells = [cell for plant in claims.PLANTS for cell in _ablated(select(rows, **{"plant.kind": plant}), variant)]
        lines.append((variant, *cells))
    names = ("turn 1 [m2]", "turn 2 [m2]", "over as printed")
    heads = [f"{plant}: {name}" for plant in claims.PLANTS for name in names]
    return markdown_table(("variant", *heads), lines, 1)


def _ablated(rows: Sequence[Row], variant: str) -> list[str]:
    """Both turns and the ratio of a variant on one plant."""
    runs, printed = select(rows, variant=variant), select(rows, variant=PRINTED)
    turns = [mean(runs, lambda row, k=k: float(row["per_turn"][k]["lateral_mse"])).short(4) for k in (0, 1)]
    return [*turns, ratio(runs, printed, field("lateral_mse")).text() if variant != PRINTED else "1"]


def claim_blocks(study: Study) -> dict[str, str]:
    """The judged claims; draws their figures."""
    rows = claims.claim_rows(study)
    if not rows:
        return {}
    figures.write_claim_figures(rows, study.images)
    return {"claims": judgement.claims_table(judgement.judged(rows))}


def limit_blocks(study: Study) -> dict[str, str]:
    """What each law survives, and how far the bicycle predicts the tractor; draws both figures."""
    found = {}
    if rows := study.done("survival", survival.survival_search, survival.JOBS):
        found["survival"] = survival.survival_table(rows)
        save(survival.survival_figure(rows), study.images / "verdict_survival.png")
    if rows := study.done("validity", validity.validity_drive, validity.JOBS):
        found["validity"] = validity.validity_table(rows)
        save(validity.validity_figure(rows), study.images / "verdict_validity.png")
    return found


def sweep_blocks(study: Study) -> dict[str, str]:
    """Tables of sweeps that come with the package."""
    found = {}
    if rows := study.there("results"):
        found["closed"] = validity.closed_loop_table(rows)
    if rows := study.rows("ablation"):
        found["ablation"] = ablation_table(rows)
    first, again = study.rows("controllers"), study.rows("controllers_again", "controllers", seeds=AGAIN)
    if first and again:
        sets = ranking.by_ground(first), ranking.by_ground(again)
        found |= {"ranking": ranking.ranking_table(*sets)}
        found |= {"ranked": ranking.compared_text(ranking.compare_sets(*sets))}
    return found


def importance_blocks(study: Study) -> dict[str, str]:
    """Which uncertain numbers matter; copies the figures."""
    found = {}
    for name in ("importance", "importance_sobol"):
        if study.rows(name):
            shares = importance(study.runs / name)
            told = importance_text(shares, "xte_rms").replace("\n", " ")
            found[name] = f"{importance_table(shares)}\n\n{told}"
            shutil.copyfile(study.runs / name / "importance.png", study.images / f"verdict_{name}.png")
    return found


def main(arguments: list[str] | None = None) -> None:
    study = Study("verdict", __doc__, arguments)
    study.write({**claim_blocks(study), **limit_blocks(study), **sweep_blocks(study), **importance_blocks(study)})


if __name__ == "__main__":
    main()
