"""docs/results.md: the comparison of the stack, guidance laws by surface, by estimator and by seed.

Each cell is one turn of the figure eight (or a short field of swaths), each seed other noise: the mean of the
cross-track rms over the seeds, with its 95 % bootstrap interval.
"""

import json
from itertools import product

import matplotlib as mpl
from estimates import by_seed, difference, estimate, field
from matplotlib.figure import Figure
from sweeps import Row, Study, shipped, variants

from agrobot_mj.control import Nmpc
from agrobot_mj.core.markdown import markdown_table
from agrobot_mj.core.palette import BLUE, VERMILION
from agrobot_mj.studies.statistics import bootstrap_interval
from agrobot_mj.studies.style import STYLE, save

LAWS, GRID = list(variants("results")), shipped("results")
ESTIMATORS = {"ekf": VERMILION, "ekf_full": BLUE}
"""Colours by estimator."""
LEVEL, BICYCLE, LOSS, SWATHS = "level", "level, bicycle", "GNSS loss of 5 s", "swaths"
SURFACES = (LEVEL, "soil", "rough D", "side slope 10 deg", LOSS, BICYCLE, SWATHS)
"""Surfaces in the order of tables and figures."""
NETWORK = "network tuned"
RIVALS = ("network as printed", "integral of sgn tuned", "PI", "P + feed-forward", "PI + feed-forward", "LQR", "nmpc")
"""Laws that the tuned network should beat."""
Cells = dict[tuple[str, str, str], dict[int, float]]
"""Cross-track rms [m] by (estimator, surface, law) and seed, NaN of a run that failed."""


def grids() -> dict[str, dict[str, object]]:
    """What differs from the sweep `results` in the other sweeps of the page."""
    compensated = [{"kind": kind, "terrain_compensation": True} for kind in ESTIMATORS]
    tilted = [{"kind": "rough", "iso_class": "D"}, {"kind": "slope", "grade_deg": 10.0}]
    loss, estimator = {"kind": "gnss_loss", "start_s": 60.0, "end_s": 65.0}, GRID["axes"]["estimator"]
    of_swaths = {key: value for key, value in GRID["set"].items() if key != "path.turns"}
    return {
        "results": {},
        "tilted": {
            "set": {**GRID["set"], "sensors.imu.enabled": True},
            "axes": {"estimator": compensated, "terrain": tilted},
        },
        "loss": {"set": {**GRID["set"], "fault": [loss]}, "axes": {"estimator": estimator}},
        "swaths": {"base": "clothoid_swaths", "set": of_swaths, "axes": {"estimator": estimator[1:]}},
    }


def surface(grid: str, row: Row) -> str:
    """The surface of a run."""
    if grid in ("loss", "swaths"):
        return LOSS if grid == "loss" else SWATHS
    if grid == "tilted":
        return "rough D" if json.loads(row["terrain"])["kind"] == "rough" else "side slope 10 deg"
    plant = json.loads(row["plant"])
    return BICYCLE if plant["kind"] == "bicycle" else "soil" if "tyre" in plant else LEVEL


def cells_of(study: Study) -> Cells:
    """All cells, of sweeps that are run as far as they are missing."""
    found: dict[tuple[str, str, str], list[Row]] = {}
    for grid, changes in grids().items():
        for row in study.rows(grid, "results", **changes):
            key = json.loads(row["estimator"])["kind"], surface(grid, row), row["variant"]
            found.setdefault(key, []).append(row)
    return {key: by_seed(rows, field("xte_rms")) for key, rows in found.items()}


def table(cells: Cells, estimator: str) -> str:
    """A row per law, a column per surface, mean and interval [cm]."""
    surfaces = [s for s in SURFACES if any((estimator, s, law) in cells for law in LAWS)]
    rows = [(law, *(_text(cells.get((estimator, s, law), {})) for s in surfaces)) for law in LAWS]
    return markdown_table(("law", *surfaces), rows) if surfaces else ""


def _text(values: dict[int, float]) -> str:
    return estimate(values.values(), bootstrap_interval).text(1, 100)


def differences(cells: Cells) -> str:
    """Paired differences of the tuned network to the laws that it should beat [cm]."""
    rows = []
    for estimator, where in product(ESTIMATORS, SURFACES):
        network = cells.get((estimator, where, NETWORK), {})
        found = [difference(network, cells.get((estimator, where, law), {}), bootstrap_interval) for law in RIVALS]
        if network:
            rows.append((f"`{estimator}`", where, *(each.text(1, 100, "+") for each in found)))
    return markdown_table(("estimator", "surface", *(f"less {law}" for law in RIVALS)), rows) if rows else ""


def figure(cells: Cells) -> Figure:
    """Cross-track rms by law and surface, both estimators, with intervals."""
    drawn = Figure((7.2, 4.6), layout="constrained")
    for axes, where in zip(drawn.subplots(2, 3, sharex=True, sharey=True).flat, SURFACES[:-1], strict=True):
        for (estimator, colour), shift in zip(ESTIMATORS.items(), (0.15, -0.15), strict=True):
            for k, law in enumerate(reversed(LAWS)):
                found = estimate(cells.get((estimator, where, law), {}).values(), bootstrap_interval)
                axes.plot([100 * found.low, 100 * found.high], [k + shift] * 2, color=colour, lw=1.5)
                label = estimator if k == 0 else None
                axes.plot(100 * found.mean, k + shift, "o", ms=4, color=colour, label=label)
        axes.set(title=where, xscale="log")
        axes.set_yticks(range(len(LAWS)), list(reversed(LAWS)))
        axes.set_xticks([1, 2, 5, 10, 20, 50], ["1", "2", "5", "10", "20", "50"])
        axes.minorticks_off()
    for axes in drawn.axes[3:]:
        axes.set_xlabel("cross-track rms [cm]")
    drawn.axes[0].legend(loc="lower right", title="estimator")
    return drawn


def main(arguments: list[str] | None = None) -> None:
    study = Study("results", __doc__, arguments)
    if not study.only_draw and "nmpc" in (study.variants or LAWS):
        Nmpc().memory()  # raises now, not after half the runs, where casadi is missing
    cells = cells_of(study)
    study.write({**{name: table(cells, name) for name in ESTIMATORS}, "differences": differences(cells)})
    with mpl.rc_context(STYLE):
        save(figure(cells), study.images / "laws.png")


if __name__ == "__main__":
    main()
