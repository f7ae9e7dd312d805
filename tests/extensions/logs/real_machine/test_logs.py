"""Reading the logs of the riding tractor from a clone: units, held rows, failures of the receivers, passes."""

import numpy as np
import pytest
from clones import STRAIGHT, Drive, clone, line
from riding_tractor import gnss
from riding_tractor.closed_loop import recorded
from riding_tractor.logs import Repository, Run, field_log, fresh, pursuit_log

from agrobot_mj.extensions.logs.pieces import spells

RUN = Run("made", "field.csv", "pursuit.csv")


@pytest.fixture(scope="module")
def repository(tmp_path_factory):
    """A pass of 26 m with two seconds of quality 2, after which the file says nothing of its receivers for a while."""
    drive = Drive(line(26.0))
    drive.lost = {(5.0, 7.0): "DGPS"}
    drive.run(50.0)
    drive.speed = 0.0
    drive.run(8.0)
    return clone(tmp_path_factory.mktemp("clone"), {"field.csv": drive.field_csv, "pursuit.csv": drive.pursuit_csv})


def test_files_are_those_of_the_commit(repository):
    (repository.folder / "field.csv").write_text("another")
    assert repository.read("field.csv").startswith(b"time,")


def test_what_is_not_there_is_said_with_the_way_to_get_it(tmp_path):
    with pytest.raises(SystemExit, match=r"no a\.csv at commit 0123.*\n.*git clone https://example\.org/it"):
        Repository(tmp_path, "https://example.org/it", "0123456789").read("a.csv")


def test_columns_come_in_the_units_that_they_have(repository):
    log = field_log(repository, RUN)
    assert log.t[0] == pytest.approx(1785859200.0)
    assert np.diff(log.t) == pytest.approx(0.05, abs=2e-3)
    assert log.pot[600:700].mean() == pytest.approx(STRAIGHT, abs=1.0)
    assert set(log.quality) == {4.0, 2.0}
    assert log.auto.all()


def test_positions_that_are_held_do_not_count_twice(repository):
    log = field_log(repository, RUN)
    counted = np.isfinite(log.latitude)
    assert counted[400:800].mean() > 0.9, "25 mm in a row are more than a step of the position"
    assert counted[-100:].sum() == 0, "at rest"
    assert fresh(np.array([1.0, 1.0, 2.0]), np.array([0.0, 1.0, 1.0])).tolist() == [True, True, True]
    assert spells(np.array([True, False, True, True])) == [(0, 1), (2, 4)]


def test_failures_are_found_with_what_the_flags_say(repository):
    log = field_log(repository, RUN)
    (spell,) = gnss.stretches("made", log, log.quality == gnss.DGPS)
    assert (spell.start, spell.lasts) == pytest.approx((5.0, 2.0), abs=0.06)
    assert (spell.fixed, spell.valid) == (1.0, 1.0)
    (silence,) = gnss.silences("made", log, log.receiver)
    assert silence.lasts == pytest.approx(7.0, abs=0.15)


def test_a_stop_by_the_gate_is_found_with_its_way(repository, monkeypatch):
    monkeypatch.setattr(gnss, "CALIBRATION", (RUN,))
    monkeypatch.setattr(gnss, "HELD_OUT", ())
    (stop,) = gnss.stops(repository)
    assert stop.reason.startswith("fix_quality='DGPS'")
    assert stop.way == pytest.approx(0.5**2 / (2 * 0.5), abs=0.03), "v^2 / 2a"


def test_a_pass_is_measured_beside_its_waypoints(repository):
    """A firmware centre 15 counts too far left leaves it 5.9 cm to the left."""
    found = recorded(pursuit_log(repository, RUN))
    assert found.left == pytest.approx(5.9, abs=0.4)
    assert found.mean == pytest.approx(abs(found.left), abs=0.1)
    assert found.speed == pytest.approx(0.5, rel=0.01)
    assert found.wanted.mean() == pytest.approx(-2.14, abs=0.1)
