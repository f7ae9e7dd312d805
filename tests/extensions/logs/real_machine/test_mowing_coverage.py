"""The coverage run: offsets of passes with a sensor that slips, and distances from a way."""

import numpy as np
import pytest
from clones import Drive, clone, geodetic, line
from riding_tractor import coverage
from riding_tractor.coverage import STRAIGHT_M, beside
from riding_tractor.logs import Run


@pytest.fixture(scope="module")
def track(tmp_path_factory):
    """Two passes eastwards, with the sensor 15 and 40 counts below the firmware's centre, as one log."""
    drives = [Drive(line(60.0, 0.49, STRAIGHT_M), straight) for straight in (432.0, 407.0)]
    rows = []
    for k, drive in enumerate(drives):
        drive.t = 200.0 * k
        drive.run(100.0)
        rows += drive.field[:: round(coverage.EVEN_S / 0.05)]
        rows[-1] = rows[-1].replace(",0,", ",1,", 1)  # by hand on the way back
    points = line(60.0, 0.49, STRAIGHT_M)
    mission = "\n".join("{:.10f} {:.10f} 0.0 3.00 0.50".format(*geodetic(x, y)) for x, y, _ in points)
    files = {"field.csv": "\n".join((drives[0].field_csv.split("\n")[0], *rows)) + "\n", "mission.txt": mission}
    repository = clone(tmp_path_factory.mktemp("coverage"), files)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(coverage, "COVERAGE", Run("made", "field.csv"))
        patch.setattr(coverage, "MISSION", "mission.txt")
        return coverage.track(repository)


def test_the_offset_follows_the_reading_straight_ahead(track):
    first, second = coverage.straights(track)
    assert (first.pot, second.pot) == pytest.approx((432.0, 407.0), abs=1.0)
    assert first.left == pytest.approx(first.expected(0.0), abs=0.02)
    assert second.left == pytest.approx(second.expected(0.0), abs=0.02)
    assert second.left > 0.3
    assert not first.westwards


def test_distances_are_those_from_the_nearest_piece_of_a_way():
    way = np.array([[0.0, 10.0, 10.0], [0.0, 0.0, 10.0]])
    points = np.array([[5.0, 12.0, -3.0], [1.0, 5.0, 4.0]])
    assert beside(points, way) == pytest.approx([1.0, 2.0, 5.0])
