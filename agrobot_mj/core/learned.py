"""Table `learned.parquet` of the quantities learned in a run, which a later run can use as initial values.

Columns:

- `quantity`: name of the log signal.
- `place_m`: arc length along the lap [m], or null for a value without a location.
- `value`: learned value, in the unit of the log signal.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from agrobot_mj.core.resources import checked_path, refuse
from agrobot_mj.core.signals import Array

LEARNED = "learned.parquet"
MOST_BYTES = 50e6  # Maximum size of an input file [bytes], which corresponds to a map of 1000 km

Learned = Mapping[str, Array]
"""Learned values by log signal, as arrays (n, 2) of arc length [m] (NaN without a location) and value."""


def learned_table(learned: Learned) -> Any:
    """Return the learned values as a pyarrow table with the columns `quantity`, `place_m` and `value`."""
    import pyarrow as pa

    names = [name for name, rows in learned.items() for _ in rows]
    numbers = np.concatenate([np.empty((0, 2)), *learned.values()])
    place = pa.array(numbers[:, 0], mask=np.isnan(numbers[:, 0]))
    return pa.table({"quantity": names, "place_m": place, "value": numbers[:, 1]})


def read_learned(name: str) -> Learned:
    """Return the learned values in the file `name`. Raises ValueError for an invalid file."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    path = checked_path(name, [".parquet"], int(MOST_BYTES))
    try:
        table = pq.read_table(path, columns=["quantity", "place_m", "value"])
        quantities = np.array(table["quantity"].to_pylist(), dtype=object)
        numbers = np.column_stack([table[key].to_numpy().astype(float) for key in ("place_m", "value")])
    except (pa.ArrowException, KeyError, OSError, TypeError, ValueError):
        refuse(path, f"the file has no columns quantity, place_m and value; specify the {LEARNED} of a run")
    if not np.isfinite(numbers[:, 1]).all():
        refuse(path, f"the file has values that are not numbers; specify the {LEARNED} of a run")
    return {str(quantity): numbers[quantities == quantity] for quantity in dict.fromkeys(quantities)}
