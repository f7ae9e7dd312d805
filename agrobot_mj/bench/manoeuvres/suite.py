"""All manoeuvres in a row: checks, figures, `validation.json` and the page `validation.md`."""

import sys
import time
from collections.abc import Callable
from math import isfinite
from pathlib import Path

from agrobot_mj.bench.manoeuvres import (
    antenna_lean,
    braking,
    closed_motions,
    coasting,
    convergence,
    cornering,
    energy,
    implements,
    kingpins,
    loads,
    machines,
    parked_across,
    parking,
    ruts,
    side_slope,
    size,
    sliding,
    soak,
    steering,
    step_steer,
    tipping,
    vibration,
)
from agrobot_mj.bench.manoeuvres.base import About, Check, Run, Trial
from agrobot_mj.bench.manoeuvres.figures import write_figures
from agrobot_mj.bench.manoeuvres.tables import page
from agrobot_mj.simulation.ownership import reserve
from agrobot_mj.simulation.storage import atomic, exclusive, write_json

MANOEUVRES: dict[str, Run] = {
    "parking": parking.run,
    "brake": braking.run,
    "parked across": parked_across.run,
    "loads": loads.run,
    "tipping": tipping.run,
    "coasting": coasting.run,
    "side slope": side_slope.run,
    "machine size": size.run,
    "antenna lean": antenna_lean.run,
    "machines": machines.run,
    "constant radius": cornering.run,
    "step steer": step_steer.run,
    "steering": steering.run,
    "kingpins": kingpins.run,
    "sliding": sliding.run,
    "ruts": ruts.run,
    "vibration": vibration.run,
    "implements": implements.run,
    "closed motions": closed_motions.run,
    "energy": energy.run,
    "convergence": convergence.run,
    "soak": soak.run,
}
"""Manoeuvres by the name in their checks, in the order of the page."""

FILES = ("validation.json", "validation.md", "images")
"""What is written, of which the last is a folder."""


def validate(
    out: Path, quick: bool = False, on_finished: Callable[[str, list[Check], float], None] | None = None
) -> list[Check]:
    """Drive every manoeuvre and write the results into `out`; returns all checks, also those that failed.

    `quick` takes a minute, the full set a few. `on_finished` is called after each manoeuvre with its name, its checks
    and the seconds that it took. Files: `validation.json`, `validation.md`, `images/*.png`.
    """
    found: dict[str, Trial] = {}
    with exclusive(out, FILES):
        for name, run in MANOEUVRES.items():
            began = time.perf_counter()
            found[name] = Trial(name, quick).drive(run)
            if on_finished is not None:
                on_finished(name, found[name].checks, time.perf_counter() - began)
        checks = [check for driven in found.values() for check in driven.checks]
        warned = sum(driven.warnings for driven in found.values())
        checks.append(About("MuJoCo", "warnings in all manoeuvres", "mujoco", "").none(warned))
        reserve(out, FILES)
        write_figures(found, out / "images")
        write_json(out / "validation.json", [as_row(check) for check in checks])
        texts = {name: sys.modules[run.__module__].__doc__ or "" for name, run in MANOEUVRES.items()}
        with atomic(out / "validation.md") as part:
            part.write_text(page(checks, texts), encoding="utf-8")
    return checks


def as_row(check: Check) -> dict[str, str | float | bool | None]:
    """The check for JSON: its fields, None for values that are not finite, and whether it passed."""
    fields = check._asdict().items()
    row = {name: None if isinstance(value, float) and not isfinite(value) else value for name, value in fields}
    return {**row, "passed": check.passed}
