"""docs/results.md: run the comparison of the stack (resumes by itself), and write its tables and its figure."""

import argparse
from pathlib import Path

import matplotlib as mpl
import numpy as np
from blocks import put
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from agrobot_mj.control import Nmpc
from agrobot_mj.core.version import __version__
from agrobot_mj.simulation.progress import task
from agrobot_mj.studies.headline import (
    LAWS,
    NETWORK,
    NETWORK_TUNED,
    ORDER,
    by_cell,
    cells,
    interval,
    paired,
    study,
    table,
)
from agrobot_mj.studies.style import STYLE

ROOT = Path(__file__).parent.parent
PAGE, IMAGE = ROOT / "docs" / "results.md", ROOT / "docs" / "images" / "laws.png"


def differences(rows: list[dict]) -> str:
    """Paired differences of the tuned network to the laws that it should beat, in cm."""
    values, network = by_cell(rows, "xte_rms"), NETWORK_TUNED
    others = (NETWORK, "integral of sgn tuned", "PI", "P + feed-forward", "PI + feed-forward", "LQR", "nmpc")
    head = " | ".join(f"less {law}" for law in others)
    lines = [f"| estimator | surface | {head} |", "|---" * (2 + len(others)) + "|"]
    for estimator, surface in ((e, s) for e in ("ekf", "ekf_full") for s in ORDER):
        if (estimator, surface, network) not in values:
            continue
        texts = []
        for other in others:
            if (estimator, surface, other) not in values:
                texts.append("-")
                continue
            *found, failed = paired(values[estimator, surface, network], values[estimator, surface, other])
            d, low, high = (100 * v for v in found)
            texts.append(f"{d:+.1f} ({low:+.1f} to {high:+.1f})" + (f", {failed} seeds failed" if failed else ""))
        lines.append(f"| `{estimator}` | {surface} | " + " | ".join(texts) + " |")
    return "\n".join(lines)


def draw(rows: list[dict]) -> None:
    """Cross-track rms by law and surface, both estimators, with intervals."""
    values = by_cell(rows, "xte_rms")
    surfaces = [s for s in ORDER if s != "swaths"]
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(7.2, 4.6), layout="constrained")
        FigureCanvasAgg(figure)
        for axes, surface in zip(figure.subplots(2, 3, sharex=True, sharey=True).flat, surfaces, strict=False):
            for estimator, colour, shift in (("ekf", "#D55E00", 0.15), ("ekf_full", "#0072B2", -0.15)):
                for k, law in enumerate(reversed(LAWS)):
                    found = np.array(list(values.get((estimator, surface, law), {}).values()))
                    good = 100 * found[np.isfinite(found)]
                    if len(good):
                        low, high = interval(good)
                        axes.plot([low, high], [k + shift] * 2, color=colour, lw=1.5)
                        axes.plot(good.mean(), k + shift, "o", ms=4, color=colour, label=estimator if k == 0 else None)
            axes.set_xscale("log")
            axes.set_title(surface)
            axes.set_yticks(range(len(LAWS)), list(reversed(LAWS)))
            axes.set_xticks([1, 2, 5, 10, 20, 50], ["1", "2", "5", "10", "20", "50"])
            axes.minorticks_off()
        for axes in figure.axes[3:]:
            axes.set_xlabel("cross-track rms [cm]")
        figure.axes[0].legend(loc="lower right", title="estimator")
        figure.savefig(IMAGE, dpi=160)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=20, help="number of seeds, from 1")
    parser.add_argument("--jobs", type=int, default=None, help="processes; all cores by default")
    parser.add_argument("--rows", type=Path, default=ROOT / "runs" / "results" / "rows.jsonl")
    parser.add_argument("--only-draw", action="store_true", help="write the page from the rows that are there")
    arguments = parser.parse_args()
    seeds = range(1, arguments.seeds + 1)
    if not arguments.only_draw:
        Nmpc().memory()  # raises now, not after half the runs, where casadi is missing
    if arguments.only_draw:
        import json

        rows = [json.loads(line) for line in arguments.rows.read_text("utf-8").splitlines()]
    else:
        with task(f"{len(cells())} cells, {len(seeds)} seeds", len(cells()) * len(seeds)) as advance:
            rows = study(arguments.rows, seeds, arguments.jobs, advance)
    text = PAGE.read_text(encoding="utf-8")
    count = min(len(v) for v in by_cell(rows, "xte_rms").values())
    gains = "tuned gains, but of the laws that are called as printed"
    text = put(text, "standing", f"Version {__version__}, {count} seeds or more per cell, {gains}.")
    text = put(text, "ekf", table(rows, "ekf"))
    text = put(text, "ekf_full", table(rows, "ekf_full"))
    text = put(text, "differences", differences(rows))
    PAGE.write_text(text, encoding="utf-8")
    draw(rows)
    print(text)


if __name__ == "__main__":
    main()
