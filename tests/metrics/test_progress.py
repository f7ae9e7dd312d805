"""Progress metric, the completed fraction of the path, for given tractor positions."""

from types import SimpleNamespace

import numpy as np
import pytest

from agrobot_mj.core.signals import TICK_S
from agrobot_mj.metrics import RunView, metrics
from agrobot_mj.metrics.progress import LATE_S
from agrobot_mj.paths import Circle, FigureEight, LaneChange, Line, Manoeuvre, Swaths
from agrobot_mj.paths.manoeuvre import StraightPiece

THERE_AND_BACK = Manoeuvre(
    piece=(StraightPiece(length_m=20.0), StraightPiece(length_m=15.0, reverse=True), StraightPiece(length_m=10.0))
)
PATHS = {
    "line": Line(length_m=40.0),
    "lane_change": LaneChange(),
    "laps": Circle(radius_m=5.0, turns=3),
    "figure_eight": FigureEight(radius_m=4.0, straight_m=12.0, run_in_m=5.0, turns=2),
    "omega": Swaths(length_m=25.0, run_in_m=5.0, swath_m=2.0, count=3),
    "k": Swaths(length_m=25.0, run_in_m=5.0, swath_m=2.0, count=3, turn="k"),
    "into a row": Manoeuvre(),
    "there and back": THERE_AND_BACK,
}
every_path = pytest.mark.parametrize("path", PATHS.values(), ids=PATHS)


def ticks(path, duration=None):
    return np.arange(0.0, path.duration_s if duration is None else duration, TICK_S)


def places(path, times):
    """Return the reference positions at given times, shape (n, 2) [m]."""
    return np.array([path.at(t)[:2] for t in np.asarray(times).tolist()])


def view(path, place, duration=None):
    """Return the run of a tractor with the positions `place` (n, 2) at the ticks."""
    t = ticks(path, duration)[: len(place)]
    columns = {"t": t, "x": place[:, 0], "y": place[:, 1]}
    return RunView(
        SimpleNamespace(scenario=SimpleNamespace(path=path, duration_s=duration), column=columns.__getitem__)
    )


def share(path, place, duration=None):
    return view(path, place, duration).progress.share


def way(place):
    return float(np.hypot(*np.diff(place, axis=0).T).sum())


@every_path
def test_tractor_that_follows_its_path_has_full_progress(path):
    assert share(path, places(path, ticks(path))) == pytest.approx(1.0, abs=0.01)


@every_path
@pytest.mark.parametrize("late_s", [1.0, 3.0])
def test_lagging_tractor_has_full_progress_except_for_its_lag(path, late_s):
    """At a cusp the remaining part of a segment is also lost when the reference starts the next segment."""
    t = ticks(path)
    found = view(path, places(path, t - late_s)).progress
    cusps = {"k": 4, "into a row": 1, "there and back": 2}.get(next(k for k, p in PATHS.items() if p is path), 0)
    assert found.driven > found.length - (1 + cusps) * late_s * path.speed_m_s - 0.5
    assert found.enough or cusps


@every_path
def test_stationary_tractor_has_no_progress(path):
    for part in (0.0, 0.37):
        place = np.tile(places(path, [part * path.duration_s]), (len(ticks(path)), 1))
        found = view(path, place + np.random.default_rng(1).normal(0.0, 1e-4, place.shape)).progress
        assert found.driven == 0.0
        assert not found.enough


@every_path
def test_tractor_that_stops_keeps_its_progress(path):
    t = ticks(path)
    stopped = places(path, np.minimum(t, 0.6 * path.duration_s))
    found = view(path, stopped).progress
    assert found.driven == pytest.approx(way(stopped), rel=0.02, abs=0.5)
    assert not found.enough


def test_tractor_stopped_before_the_path_end_does_not_finish_the_path():
    path = Line(length_m=6.0, speed_m_s=1.0)
    t = ticks(path)
    driving, stopped = (places(path, late) for late in (t - 1.8, np.minimum(t, path.duration_s - 2.4)))
    assert view(path, driving).progress.enough
    assert not view(path, stopped).progress.enough


def test_tractor_that_never_moves_does_not_finish_the_path():
    path = Line(length_m=10.0, speed_m_s=1.0, ramp_s=0.0)
    end = LATE_S + 0.06
    assert not view(path, np.zeros((len(ticks(path, end)), 2)), end).progress.enough


def test_progress_includes_the_first_and_last_segments_of_the_path():
    path = Line(length_m=3.0, speed_m_s=1.0, ramp_s=0.0)
    found = view(path, places(path, ticks(path, 3.5)), 3.5).progress
    assert found.driven == pytest.approx(found.length) == pytest.approx(3.0, abs=0.06)


def test_lag_of_17_m_at_the_end_reduces_the_driven_length_by_17_m():
    path = FigureEight()
    t = ticks(path)
    place = places(path, t * (1 - 17.0 / 1.2 / path.duration_s))
    found = view(path, place).progress
    assert found.length - found.driven == pytest.approx(17.0, abs=0.6)
    assert found.enough


@pytest.mark.parametrize(("aside", "expected"), [(-4.5, 1.0), (4.5, 1.0), (-5.5, 0.0), (5.5, 0.0)])
def test_path_passed_outside_the_lateral_corridor_does_not_count_as_driven(aside, expected):
    path = Line(length_m=60.0)
    assert share(path, places(path, ticks(path)) + [0.0, aside]) == pytest.approx(expected, abs=0.01)


def test_bend_cut_inside_the_lateral_corridor_counts_as_driven():
    path = Circle(radius_m=8.0, direction="left", turns=2)
    centre = path.at(0.0)[:2] + np.array([0.0, 8.0])
    outside = places(path, ticks(path))
    assert np.hypot(*(outside - centre).T) == pytest.approx(8.0)
    assert share(path, centre + (outside - centre) * 0.5) == pytest.approx(1.0, abs=0.02)


def test_one_of_four_laps_gives_a_progress_of_25_percent():
    path = Circle(radius_m=5.0, turns=4)
    t = ticks(path)
    one_lap = places(path, np.minimum(t, path.turns_s[0][1]))
    assert share(path, one_lap) == pytest.approx(0.25, abs=0.01)


def test_skipped_part_of_the_path_does_not_count_as_driven():
    path = Line(length_m=60.0)
    t = ticks(path)
    place = places(path, t)
    place[:, 0] += np.where(place[:, 0] > 20.0, 8.0, 0.0)
    found = view(path, place).progress
    assert found.driven == pytest.approx(52.0, abs=1.0)


def test_excursion_reduces_progress_only_by_its_own_length():
    path = FigureEight()
    t = ticks(path)
    place = places(path, t)
    place[1000:1400] += [0.0, 60.0]
    found = view(path, place).progress
    assert found.length - found.driven == pytest.approx(400 * TICK_S * 1.2, abs=2.0)


def test_planned_path_length_counts_only_up_to_the_end_of_the_reference():
    path = FigureEight()
    short = places(path, ticks(path, 30.0))
    assert share(path, short, 30.0) == pytest.approx(1.0, abs=0.01)
    assert share(path, short) == pytest.approx(way(short) / way(places(path, ticks(path))), abs=0.01)
    line = Line(length_m=20.0)
    assert share(line, places(line, ticks(line, 300.0)), 300.0) == pytest.approx(1.0, abs=0.02)
    assert share(line, places(line, np.minimum(ticks(line, 300.0), 9.0)), 300.0) < 0.5


def test_progress_of_an_aborted_run_refers_to_the_planned_path():
    path = Line(length_m=100.0)
    assert share(path, places(path, ticks(path))[:200], 80.0) == pytest.approx(9.6 / 93.6, abs=0.02)


def test_progress_ignores_non_finite_positions():
    path = Line(length_m=40.0)
    place = places(path, ticks(path))
    place[100] = np.nan
    place[200] = 1e300
    assert share(path, place) > 0.9
    assert share(path, place * np.nan) == 0.0
    assert share(path, place[:0]) == 0.0


@pytest.mark.parametrize("duration", [0.05, 0.3, 0.6])
def test_driven_fraction_is_none_for_a_path_shorter_than_one_step(duration):
    path = Line(speed_m_s=0.2)
    found = view(path, np.zeros((1, 2)), duration).progress
    assert found.share is None
    assert found.enough


def test_driven_fraction_of_the_path_is_a_metric():
    path = FigureEight(turns=1)
    t = ticks(path, 30.0)
    from test_metrics import FakeLog

    log = FakeLog(path, t, x=path.at(0.0).x, y=path.at(0.0).y)
    log.scenario.duration_s = 30.0
    assert metrics(log)["progress"] == 0.0
