"""Tyre test rig: one tractor wheel on level ground with prescribed speed, slip angle, slip ratio and load.

The forces are computed by the tyre kernel of the tractor (`wheel`) or, for the tyre `contact`, by MuJoCo (`towed`).
`rig_command` measures a tyre and writes `curves.parquet` (see `sweep`) and figures.
"""

from pathlib import Path

import pyarrow.parquet as pq

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.extensions.bench.rig.figures import FIGURES
from agrobot_mj.extensions.bench.rig.sweep import load_specimen, sweep
from agrobot_mj.extensions.bench.rig.towed import Towed
from agrobot_mj.extensions.bench.rig.wheel import FRONT, REAR, Rig, Setting
from agrobot_mj.simulation.results import atomic, results
from agrobot_mj.studies.style import write_figures

__all__ = ["FRONT", "REAR", "Rig", "Setting", "Towed", "load_specimen", "rig_command"]


def rig_command(source: str, out: Path) -> list[Path]:
    """Measure a tyre, given by type or scenario, on the rig. Write curves and figures to `out`, and return the file
    paths."""
    specimen = load_specimen(source)
    with results(out, ("curves.parquet", *(f"{draw.__name__}.png" for draw in FIGURES))):
        try:
            table = sweep(specimen.tyre, specimen.tractor)
        except ValueError as error:
            raise ScenarioError(f"{source}: {error}") from None
        with atomic(out / "curves.parquet") as temporary:
            pq.write_table(table, temporary, compression="zstd")
        return [out / "curves.parquet", *write_figures(out, FIGURES, table)]
