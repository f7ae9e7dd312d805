"""Guidance by a table of inputs, and handover to guidance laws."""

from math import isnan, nan

import pytest

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.extensions.play.inputs import PlayInput, PlayTable, read_inputs, write_inputs
from agrobot_mj.extensions.play.played import nearest_time
from agrobot_mj.paths.route import SampledRoute
from agrobot_mj.scenario.loading import load_scenario
from agrobot_mj.simulation.run import run

BICYCLE = {"plant.kind": "bicycle", "duration_s": 8.0}
LINE = "tick,law,steer_rad,speed_m_s\n"


def played(file, laws=(), **keys):
    """Return the scenario keys for a circle with inputs from a table."""
    return {"guidance": {"kind": "played", "inputs": {"file": str(file)}, "laws": list(laws)}, **BICYCLE, **keys}


def test_input_table_is_unchanged_by_writing_and_reading(tmp_path):
    changes = [(0, PlayInput()), (7, PlayInput(0, 0.1 + 0.2, 1 / 3)), (9, PlayInput(2, 0.0, nan))]
    write_inputs(tmp_path / "inputs.csv", changes)
    table = read_inputs(str(tmp_path / "inputs.csv"))
    assert list(table.ticks) == [0, 7, 9]
    assert table.given[:2] == [given for _, given in changes[:2]]
    assert table.given[2].law == 2
    assert isnan(table.given[2].speed)


def test_each_row_of_the_input_table_applies_until_the_next_row():
    table = PlayTable([3, 5], [PlayInput(speed=1.0), PlayInput(speed=2.0)])
    assert [table.at(tick).speed for tick in range(7)] == [0.0, 0.0, 0.0, 1.0, 1.0, 2.0, 2.0]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("tick,law\n0,0\n", "the first line must be tick,law,steer_rad,speed_m_s"),
        (LINE + "0,0,left,1\n", "line 2: must contain four numbers"),
        (LINE + "0,0,0.1\n", "line 2: must contain four numbers"),
        (LINE + "5,0,0,1\n5,0,0,2\n", "line 3: tick must increase, got 5 after 5"),
        (LINE + "0,0,inf,1\n", "numbers must be finite"),
        (LINE + "-1,0,0,1\n", "must not be negative"),
        (LINE + "0,0,0.1,\n", "speed_m_s is missing for the driver"),
        (LINE + "0,2,0,\n", "laws: the inputs use law 2, but only 1 are listed"),
        ("", "is empty"),
    ],
)
def test_error_for_an_invalid_input_table_names_the_line(tmp_path, text, message):
    (tmp_path / "inputs.csv").write_text(text)
    with pytest.raises(ScenarioError, match=message) as found:
        load_scenario("circle", played(tmp_path / "inputs.csv", [{"kind": "lqr"}]))
    assert "guidance" in str(found.value)


@pytest.mark.parametrize(
    ("law", "message"),
    [
        ({"kind": "lqrr"}, r"laws.*\[0\]\.kind: unknown kind 'lqrr'; did you mean 'lqr'"),
        ({}, r"laws.*\[0\]\.kind: unknown kind None"),
        ({"kind": "lqr", "gain": 1}, r"laws.*\[0\]\.gain"),
        ({"kind": "played"}, "cannot be selected during play"),
    ],
)
def test_law_that_cannot_be_selected_during_play_is_rejected(law, message):
    with pytest.raises(ScenarioError, match=message):
        load_scenario("circle", {"guidance": {"kind": "played", "laws": [law]}})


def test_error_for_a_missing_input_table_names_the_play_command():
    with pytest.raises(ScenarioError, match="agrobot-mj play"):
        run(load_scenario("circle", {"guidance.kind": "played", **BICYCLE}))


def test_steering_and_speed_follow_the_input_table(tmp_path):
    (tmp_path / "inputs.csv").write_text(LINE + "0,0,0.2,1.5\n100,0,-0.2,1.5\n")
    log = run(load_scenario("circle", played(tmp_path / "inputs.csv")))
    steer, speed = log.column("steer"), log.column("speed")
    assert steer[95] == pytest.approx(0.2, abs=0.03)
    assert steer[-1] == pytest.approx(-0.2, abs=0.03)
    assert speed[95] == pytest.approx(1.5, abs=0.1)
    assert set(log.column("play_steer")) == {0.2, -0.2}


def test_law_selected_off_the_line_returns_the_tractor_to_the_line(tmp_path):
    (tmp_path / "inputs.csv").write_text(LINE + "0,0,0.05,1.5\n160,1,0,\n")
    keys = played(tmp_path / "inputs.csv", [{"kind": "stanley"}], duration_s=25.0)
    log = run(load_scenario("straight_line", keys))
    across = abs(log.column("y"))
    assert across[160] > 0.5  # the driver has left the line
    assert across[-1] < 0.1
    assert log.column("x")[-1] > log.column("x")[160] + 15.0


def test_speed_in_the_input_table_overrides_the_speed_of_guidance(tmp_path):
    (tmp_path / "inputs.csv").write_text(LINE + "0,1,0,0.8\n")
    keys = played(tmp_path / "inputs.csv", [{"kind": "kinematic"}], duration_s=15.0)
    log = run(load_scenario("straight_line", keys))
    assert log.column("speed")[-1] == pytest.approx(0.8, abs=0.08)
    assert abs(log.column("y")[-1]) < 0.1


def test_nearest_time_is_the_reference_time_of_the_nearest_path_point():
    route = SampledRoute(load_scenario("figure_eight").path)
    for t in (3.0, 31.4, 77.7):
        r = route.at(t)
        assert nearest_time(route, r.x, r.y, 100.0) == pytest.approx(t, abs=0.1)
