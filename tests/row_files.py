"""Path of the file in which a sweep stores the row of a run."""

from pathlib import Path

from agrobot_mj.studies.sweep.plan import SweepPlan
from agrobot_mj.studies.sweep.schema import read_sweep
from agrobot_mj.studies.sweep.store import Store


def row_file(folder, number):
    """Return the file that contains the row of run `number` in the folder of a sweep."""
    store = Store(Path(folder), SweepPlan(read_sweep(Path(folder, "sweep.toml"))))
    return store.row_file(store.with_identity(store.plan.task(number)))
