"""Track in the map of the report of field work."""

import numpy as np
import shapely

from agrobot_mj.extensions.fields.report import _simplified_track
from agrobot_mj.studies.pages.drive import MOST_POINTS


def test_simplified_track_stays_within_5_cm_of_a_long_track_with_turns():
    t = np.linspace(0.0, 60 * np.pi, 60_000)
    x, y = 60.0 * np.sin(t) + t, 3.0 * t + 4.0 * np.sin(2 * t)
    x[100:110] = np.nan
    found = _simplified_track(x, y)
    assert len(found[0]) <= MOST_POINTS
    known = np.isfinite(x)
    away = shapely.distance(shapely.LineString(np.column_stack(found)), shapely.points(x[known], y[known]))
    assert away.max() <= 0.05


def test_track_without_known_positions_is_empty():
    assert len(_simplified_track(np.full(3, np.nan), np.zeros(3))[0]) == 0
