"""Complete validation: checks of all manoeuvres, figures, `validation.json`, and the page `validation.md`."""

import sys
import time
from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from math import isfinite
from pathlib import Path
from textwrap import dedent

from agrobot_mj.core.identity import code_text
from agrobot_mj.core.markdown import markdown_table
from agrobot_mj.extensions.bench.manoeuvres.base import BICYCLE, About, Check, Run, Trial
from agrobot_mj.extensions.bench.manoeuvres.figures import FIGURES, write_figures
from agrobot_mj.simulation.results import results, write_json, write_text

HEAD = """# Validation

The bicycle model and the MuJoCo tractor, with each type of tyre, are compared with theory in the manoeuvres below.
`agrobot-mj validate` runs all manoeuvres, writes this page with its figures, and fails if a number is outside its
acceptance band. Except in closed-loop manoeuvres, the controller uses true values instead of measurements. The
parameters are the defaults of [models](../../reference/models.md). The module docstrings of
`agrobot_mj/extensions/bench/manoeuvres/` give the details.

A cell contains the measured value, followed by the theoretical value in brackets where theory differs between tyres.
Numbers in *italics* have no band: theory is missing, or the tyre is `contact`, which has no slip law. Numbers in
**bold** are outside their band.
"""
NEGLIGIBLE = 1e-3  # Magnitude below which a value is shown as smaller than this limit


def page(checks: Sequence[Check], texts: Mapping[str, str]) -> str:
    """Return the validation page as Markdown. `texts` contains the module docstring of each manoeuvre."""
    judged = [check for check in checks if check.band != "reported"]
    failed = [check for check in judged if not check.passed]
    outcome = f"{len(judged) - len(failed)} of {len(judged)} numbers are inside their bands."
    outcome += "".join(f" {c.manoeuvre} {c.quantity}: {c.measured:g}." for c in checks if c.manoeuvre not in texts)
    sections = [section(name, text, [c for c in checks if c.manoeuvre == name]) for name, text in texts.items()]
    return "\n".join([HEAD, outcome, "", *sections])


def section(name: str, text: str, checks: Sequence[Check]) -> str:
    """Return the section of one manoeuvre on the page: title, first paragraph, figure and table."""
    title, _, body = text.strip().partition("\n")
    parts = [f"## {title}", opening(body)]
    if name in FIGURES:
        draw, shows = FIGURES[name]
        parts.append(f"![{shows}](images/{draw.__name__}.png)")
    return "\n\n".join([*parts, table(checks)]) + "\n"


def opening(text: str) -> str:
    """Return the start of a docstring as Markdown, up to the first paragraph that ends with a full stop. Equations,
    which are indented, become code blocks."""
    blocks = []
    for block in text.strip().split("\n\n"):
        equation = block.startswith("    ")
        blocks.append(f"```\n{dedent(block)}\n```" if equation else block)
        if block.rstrip().endswith(".") and not equation:
            break
    return "\n\n".join(blocks)


def table(checks: Sequence[Check]) -> str:
    """Return a Markdown table of checks, with one row per quantity and one column per subject."""
    subjects = sorted(dict.fromkeys(check.subject for check in checks), key=lambda subject: subject != BICYCLE)
    quantities: dict[tuple[str, str], dict[str, Check]] = {}
    for check in checks:
        quantities.setdefault((check.quantity, check.unit), {})[check.subject] = check
    head = ["quantity", "theory", *subjects, "band"]
    rows = []
    for (quantity, unit), by_subject in quantities.items():
        found = list(by_subject.values())
        theories = {check.theory for check in found if check.theory is not None}
        common = len(theories) == 1 and all(check.theory is not None for check in found)
        bands = dict.fromkeys(check.band for check in found if check.band != "reported")
        cells = [_cell(by_subject.get(subject), not common) for subject in subjects]
        theory = number(theories.pop()) if common else "(each)" if theories else ""
        rows.append([f"{quantity} [{unit}]" if unit else quantity, theory, *cells, ", ".join(bands) or "-"])
    return markdown_table(head, rows, 1)


def _cell(check: Check | None, own_theory: bool) -> str:
    if check is None:
        return ""
    text = number(check.measured)
    if own_theory and check.theory is not None:
        text += f" ({number(check.theory)})"
    if not check.passed:
        return f"**{text}**"
    return f"*{text}*" if check.band == "reported" else text


def number(value: float) -> str:
    """Return a number as text with four significant digits, as an integer from 1000, or as an upper limit if
    negligible."""
    if value == 0 or abs(value) >= NEGLIGIBLE:
        return f"{value:.0f}" if abs(value) >= 1000 else f"{value:.4g}"
    return f"< {NEGLIGIBLE:g}"


MODULES = (
    *("parking", "braking", "parked_across", "standing", "loads", "tipping", "coasting", "side_slope", "size"),
    *("antenna_lean", "machines", "cornering", "step_steer", "steering", "kingpins", "sliding", "ruts", "vibration"),
    *("implements", "closed_motions", "energy", "convergence", "filters", "references", "soak"),
)
"""Modules of the manoeuvres, in the order of their sections on the page."""
NAMES = {"braking": "brake", "size": "machine size", "cornering": "constant radius", "references": "outside references"}
"""Manoeuvre names that differ from the module name, by module."""
MANOEUVRES: dict[str, Run] = {
    NAMES.get(module, module.replace("_", " ")): import_module(f"{__package__}.{module}").run for module in MODULES
}

FILES = ("validation.json", "validation.md", "images/")  # Files and folder written by a validation


def validate(
    out: Path, quick: bool = False, on_finished: Callable[[str, list[Check], float], None] | None = None
) -> list[Check]:
    """Run every manoeuvre, write the results to `out`, and return all checks, including failed ones.

    `quick` selects shorter manoeuvres. `on_finished` is called after each manoeuvre with its name, its checks and its
    duration [s]. Files: `validation.json`, `validation.md`, `images/*.png`.
    """
    found: dict[str, Trial] = {}
    with results(out, FILES):
        for name, run in MANOEUVRES.items():
            began = time.perf_counter()
            found[name] = Trial(name, quick).drive(run)
            if on_finished is not None:
                on_finished(name, found[name].checks, time.perf_counter() - began)
        checks = [check for driven in found.values() for check in driven.checks]
        warned = sum(driven.warnings for driven in found.values())
        checks.append(About("MuJoCo", "warnings in all manoeuvres", "mujoco", "").none(warned))
        write_figures(found, out / "images")
        write_json(out / "validation.json", [{**as_row(check), "code": code_text()} for check in checks])
        texts = {name: sys.modules[run.__module__].__doc__ or "" for name, run in MANOEUVRES.items()}
        write_text(out / "validation.md", page(checks, texts))
    return checks


def as_row(check: Check) -> dict[str, str | float | bool | None]:
    """Return a check as JSON values: its fields and whether it passed. NaN and infinite values are None."""
    fields = check._asdict().items()
    row = {name: None if isinstance(value, float) and not isfinite(value) else value for name, value in fields}
    return {**row, "passed": check.passed}
