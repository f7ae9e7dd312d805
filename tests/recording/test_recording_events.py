import numpy as np
import pytest
from recorded import Recorded, replay

from agrobot_mj import load_scenario, run
from agrobot_mj.recording import Recording

FAULTS = [
    {"kind": "gnss_loss", "start_s": 4.0, "end_s": 6.0},
    {"kind": "gnss_loss", "start_s": 9.95, "end_s": 10.0},
    {"kind": "friction", "start_s": 8.0},
]


@pytest.fixture(scope="module")
def faulty(tmp_path_factory):
    path = tmp_path_factory.mktemp("faulty") / "run.rrd"
    scenario = load_scenario("straight_line", {"duration_s": 12, "fault": FAULTS})
    return Recorded(path, run(scenario, (Recording(path),)))


def marks(recorded):
    """Return tick, label and position of each event."""
    times, labels = recorded.column("/world/events", "Points3D:labels")
    _, places = recorded.column("/world/events", "Points3D:positions")
    found = zip(times // 50_000_000, labels, places, strict=True)
    return [(int(tick), label, np.array(place)) for tick, (label,), (place,) in found]


def lane(recorded, path):
    times, states = recorded.column(f"/states/{path}", "StateChange:state")
    return [(int(tick), state) for tick, (state,) in zip(times // 50_000_000, states, strict=True)]


def test_fault_markers_show_the_place_and_time_of_fault_starts_and_ends(faulty):
    found = [(tick, label) for tick, label, _ in marks(faulty) if "limit" not in label]
    assert found == [
        *[(80, "GNSS loss begins"), (120, "GNSS loss ends"), (160, "friction begins")],
        *[(199, "GNSS loss begins"), (200, "GNSS loss ends")],
    ]
    for tick, _, place in marks(faulty):
        expected = [faulty.log.column(name)[tick] for name in ("x", "y")]
        np.testing.assert_allclose(place[:2], expected, atol=1e-5)
        assert 0 < place[2] < 0.3


def test_each_kind_of_fault_has_a_row_in_the_state_plot(faulty):
    assert lane(faulty, "fault/gnss_loss") == [
        *[(0, "off"), (80, "active"), (120, "off"), (199, "active"), (200, "off")],
    ]
    assert lane(faulty, "fault/friction") == [(0, "off"), (160, "active")]
    assert lane(faulty, "run") == [(0, "running"), (239, "completed")]


def test_run_without_faults_has_no_fault_rows_in_the_state_plot(eight):
    assert not [entity for entity in eight.entities() if entity.startswith("/states/fault")]


def test_fault_active_from_the_start_is_marked(tmp_path):
    path = tmp_path / "run.rrd"
    scenario = load_scenario("straight_line", {"duration_s": 1, "fault": [{"kind": "gnss_loss"}]})
    run(scenario, (Recording(path),))
    assert [(tick, label) for tick, label, _ in marks(Recorded(path))] == [(0, "GNSS loss begins")]


def test_steering_at_its_limit_is_marked_once_per_event(short, tmp_path):
    saturated = short.column("steer_saturated")
    saturated[:] = 0
    saturated[[30, 31, 60, 90]] = 1  # never free for two seconds
    saturated[190:210] = 1
    saturated[300] = 1
    found = [tick for tick, label, _ in marks(replay(short, tmp_path / "run.rrd")) if "limit" in label]
    assert found == [30, 190, 300]


def test_number_of_event_markers_is_limited(short, tmp_path):
    faults = [{"kind": "gnss_loss", "start_s": 0.2 * k, "end_s": 0.2 * k + 0.1} for k in range(1, 60)]
    scenario = short.scenario.changed({"fault": faults})
    found = marks(replay(short, tmp_path / "run.rrd", scenario))
    assert 20 < len(found) <= 50


@pytest.mark.usefixtures("single_ticks")
def test_early_end_of_a_run_is_marked(tmp_path):
    ticks, path = iter(range(10_000)), tmp_path / "run.rrd"
    run(load_scenario("straight_line"), (Recording(path),), lambda: next(ticks) == 229)
    recorded = Recorded(path)
    tick, label, place = marks(recorded)[-1]
    assert (tick, label) == (229, "aborted")
    assert place[2] > 2.0, "not on the tractor"
    assert lane(recorded, "run")[-1] == (229, "aborted")
