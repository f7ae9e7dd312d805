"""Page docs/findings.md with its tables: claims of the paper, laws, limits, importance of parameters, learning laws.

The whole study takes hours. The same command continues an interrupted study.
"""

import shutil
from collections.abc import Sequence
from importlib import import_module

import matplotlib as mpl
from estimates import by_seed, field, mean, ratio, select
from measured.claims import PLANTS, STUDIES, claim_rows, claims_table, turn
from measured.figures import write_claim_figures
from measured.learning import behind, learners
from measured.ranking import ranking
from sweeps import Blocks, Part, Row, Study

from agrobot_mj.core.markdown import markdown_table
from agrobot_mj.studies.report import ReportedRun, lateral_error
from agrobot_mj.studies.style import STYLE, save

PRINTED = "as printed"  # Variant of the sweep `ablation` with which the other variants are compared


def claims(study: Study) -> Blocks:
    """Return the table of the paper's claims, and draw the figures of the claims and of the lateral error with the
    first seed."""
    rows = claim_rows(study)
    if not rows:
        return {}
    write_claim_figures(rows, study.images)
    first = select(rows, study="paper", seed=rows[0]["seed"])
    runs = [ReportedRun(row["plant"], row["law"], study.kept(STUDIES["paper"], row)) for row in first]
    with mpl.rc_context(STYLE):
        save(lateral_error(runs), study.images / "lateral_error.png")
    return {"claims": claims_table(rows)}


def ablation(study: Study) -> Blocks:
    """Return a table of network variants: lateral mean square error per turn, and ratio to the network of the paper."""
    rows = study.rows("ablation")
    lines = [
        (variant, *(cell for plant in PLANTS for cell in _ablated(select(rows, **{"plant.kind": plant}), variant)))
        for variant in dict.fromkeys(row["variant"] for row in rows)
    ]
    names = ("turn 1 [m2]", "turn 2 [m2]", "over as printed")
    heads = ("variant", *(f"{plant}: {name}" for plant in PLANTS for name in names))
    return {"ablation": markdown_table(heads, lines, 1) if lines else ""}


def _ablated(rows: Sequence[Row], variant: str) -> list[str]:
    """Return the cells of a variant on one plant: errors in both turns, and ratio to the network of the paper."""
    runs, printed = select(rows, variant=variant), select(rows, variant=PRINTED)
    turns = [mean(runs, turn("lateral_mse", number)).short(4) for number in (1, 2)]
    over = ratio(*(by_seed(some, field("lateral_mse")) for some in (runs, printed))).text()
    return [*turns, over if variant != PRINTED else "1"]


def shares(study: Study) -> Blocks:
    from agrobot_mj.extensions.search.importance.results import importance, importance_rows, importance_texts

    found = {}
    for name in ("importance", "importance_sobol"):
        if study.rows(name):
            shares = importance(study.runs / name)
            head, rows = importance_rows(shares)
            table = markdown_table(head, [(f"`{key}`", *cells) for key, *cells in rows], 1)
            told = " ".join(importance_texts(shares, "xte_rms")).replace("\n", " ")
            found[name] = f"{table}\n\n{told}"
            shutil.copyfile(study.runs / name / "importance.png", study.images / f"{name}.png")
    return found


PARTS: dict[str, Part] = {part.__name__: part for part in (claims, ablation, ranking, learners, behind)}
PARTS |= {"survival": lambda study: import_module("measured.survival").survival(study), "importance": shares}
