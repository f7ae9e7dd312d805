"""Waypoint files: paths through valid files, and messages for invalid files."""

import os
from math import pi

import numpy as np
import pytest

from agrobot_mj import load_scenario
from agrobot_mj.cli import main
from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.paths import Waypoints, sample
from agrobot_mj.paths.waypoints import MAX_BYTES, MAX_ROWS


def route(folder, rows, header="", name="route.csv"):
    """Write a waypoint file; return its path."""
    file = folder / name
    file.write_text(header + "\n".join(",".join(str(value) for value in row) for row in rows) + "\n")
    return str(file)


def ring(radius=20.0, count=24):
    angles = np.linspace(0, 2 * pi, count, endpoint=False)
    return np.column_stack([radius * np.cos(angles), radius * np.sin(angles)])


def polyline(path):
    return sample(path, np.linspace(0, path.duration_s, 5000))


def gaps(path, points):
    """Return the distance of each waypoint from the path."""
    path_points = polyline(path)
    return np.array([np.hypot(*(path_points - point).T).min() for point in np.asarray(points)[:, :2]])


@pytest.mark.parametrize("header", ["", "x,y\n", '"east [m]", north\n\n'])
def test_path_without_smoothing_passes_every_waypoint(tmp_path, header):
    points = ring()[:18]
    path = Waypoints(file=route(tmp_path, points, header), smoothing_m=0, corners="spline")
    assert gaps(path, points).max() < 0.02
    assert path.at(0)[:2] == pytest.approx(points[0])
    assert path.at(path.duration_s)[:2] == pytest.approx(points[-1], abs=0.01)


def test_smooth_path_through_waypoints_on_a_circle_is_circular(tmp_path):
    path = Waypoints(file=route(tmp_path, ring()), closed=True, smoothing_m=0, laps=2, corners="spline")
    path_points = polyline(path)
    assert np.hypot(*path_points.T) == pytest.approx(20, abs=0.01)
    assert path.max_curvature == pytest.approx(1 / 20, rel=0.03)
    assert path.motion.distances[-1] == pytest.approx(2 * 2 * pi * 20, rel=1e-3)
    (a, b), (c, d) = path.turns_s
    assert (a, b, d) == (0.0, c, path.duration_s)
    assert path.at(b)[:2] == pytest.approx((20, 0), abs=0.01)
    assert path.at(d)[:2] == pytest.approx((20, 0), abs=0.01)


def test_file_that_repeats_its_first_row_at_the_end_is_accepted(tmp_path):
    closed = Waypoints(file=route(tmp_path, ring()), closed=True, smoothing_m=0, corners="spline")
    repeated = Waypoints(
        file=route(tmp_path, [*ring(), ring()[0]], name="b.csv"), closed=True, smoothing_m=0, corners="spline"
    )
    assert repeated.duration_s == pytest.approx(closed.duration_s)


def test_smoothing_removes_waypoint_noise(tmp_path):
    x = np.arange(0, 60, 1.0)
    noisy = np.column_stack([x, np.random.default_rng(1).normal(0, 0.05, x.size)])
    file = route(tmp_path, noisy)
    smooth, through = (
        Waypoints(file=file, smoothing_m=0.06, corners="spline"),
        Waypoints(file=file, smoothing_m=0, corners="spline"),
    )
    assert smooth.max_curvature < 0.05 * through.max_curvature
    assert np.sqrt((gaps(smooth, noisy) ** 2).mean()) < 0.065


def test_path_speed_is_limited_by_waypoint_speeds_and_the_speed_key(tmp_path):
    rows = [(x, 0, 2.0 if x < 50 else 0.5) for x in range(0, 101, 10)]
    path = Waypoints(file=route(tmp_path, rows, "x,y,speed\n"), speed_m_s=1.5)
    grid = np.linspace(0, path.duration_s, 2000).tolist()
    x, v = np.array([(r.x, r.vx) for r in map(path.at, grid)]).T
    assert v[x > 50.5].max() == pytest.approx(0.5)
    assert v.max() == pytest.approx(1.5)


def test_three_waypoints_are_accepted(tmp_path):
    path = Waypoints(file=route(tmp_path, [(0, 0), (10, 1), (20, 0)]))
    assert path.at(path.duration_s)[:2] == pytest.approx((20, 0), abs=0.2)


def test_two_waypoints_form_a_straight_line(tmp_path):
    path = Waypoints(file=route(tmp_path, [(0, 0), (30, 40)]))
    assert path.max_curvature == pytest.approx(0, abs=1e-9)
    assert path.at(path.duration_s)[:2] == pytest.approx((30, 40), abs=0.01)
    with pytest.raises(ValueError, match="2 different waypoints; at least 3 are required"):
        Waypoints(file=path.file, closed=True).check()


def test_edited_waypoint_file_gives_a_different_path(tmp_path):
    file = route(tmp_path, [(0, 0), (10, 1), (20, 0)])
    before = Waypoints(file=file)
    end = before.at(before.duration_s).x
    route(tmp_path, [(0, 0), (10, 1), (30, 0)])
    os.utime(file, ns=(1, 1))
    after = Waypoints(file=file)
    assert before != after
    assert after.at(after.duration_s).x == pytest.approx(end + 10, abs=0.1)


GOOD = "0,0\n10,0\n20,0\n"
FAULTS = {
    "a word": (GOOD + "30,abc\n", "row 4: y is not a number: 'abc'; write a number, or remove the row"),
    "two separators": ("0,0\n1;0\n", "row 2: the row contains semicolons or tabs; use the same separator"),
    "not a number": (GOOD + "nan,0\n", "row 4: x is nan; use a finite number"),
    "infinite": (GOOD + "3,-inf\n", "row 4: y is -inf; use a finite number"),
    "a gap": (GOOD + "30,\n", "row 4: y is not a number: ''"),
    "one place": ("x,y\n10,0\n\n10,0\n10,0\n", "has 1 different waypoints; at least 2 are required"),
    "empty": ("", "the file is empty; create the file again"),
    "only a header": ("x,y\n", "the file contains no positions; export the file again"),
    "a height as y": (
        "0,0,1\n10,0,9\n20,0,9\n",
        "the third column does not contain speeds and one of the first two is constant; name the columns",
    ),
    "standing still": ("0,0,1\n10,0,0\n20,0,1\n", "row 2: speed is 0 m/s; use a speed from 0.001 to 5"),
    "backwards": ("0,0,1\n10,0,-1\n20,0,1\n", "row 2: speed is -1 m/s; use a speed from 0.001 to 5"),
    "one column": ("0\n1\n2\n", "row 1: the row has 1 columns; write x, y or x, y, speed"),
    "four columns": ("0,0,1,4\n1,1,1,4\n", "row 1: the row has 4 columns; write x, y or x, y, speed"),
    "ragged": ("0,0,1\n10,0\n20,0,1\n", "row 2: the row has 2 columns, but other rows have 3; use the same number"),
    "a second header": (GOOD + "x,y\n", "row 4: x is not a number: 'x'"),
    "too many": (
        "".join(f"{k},0\n" for k in range(MAX_ROWS + 1)),
        f"has {MAX_ROWS + 1} waypoints, but the limit is {MAX_ROWS}",
    ),
    "long": ("0,0\n90e3,0\n0,1\n90e3,2\n", "km long, more than 200 km"),
    "words": ("east-west,up\n0,0\n", "row 1: the file has no columns x and y, or lat and lon; did you mean"),
    "a column without a name": ("x,theta\n0,0\n", "row 1: the file has no columns x and y, or lat and lon"),
    "degrees": ("52.3,6.72\n52.30002,6.72003\n52.30004,6.72\n", "if the numbers are degrees, name"),
    "swapped degrees": ("lat,lon\n106.7,52.3\n", "row 2: lat is 106.7, not an angle in degrees"),
    "decimal commas": ("0,0,0,0\n5,5,0,1\n", "row 1: the row has 4 columns"),
    "an endless cell": (GOOD + "30," + "1" * 200_000 + "\n", "field larger than field limit"),
    "creeping": ("0,0,1e-9\n10,0,1\n20,0,1\n", "row 1: speed is 1e-09 m/s; use a speed from 0.001 to 5"),
    "a number as programs write it": ("0,0\n1_0,0\n20,0\n", "row 2: x is not a number: '1_0'"),
    "a null byte": ("0,0\n1,\x001\n2,0\n", "the file is not text, or contains null bytes; save it as CSV"),
}


def rejection(tmp_path, file):
    """Return the error message of a scenario with the waypoint file `file`."""
    scenario = tmp_path / "mine.toml"
    scenario.write_text(f'[path]\nkind = "waypoints"\nfile = "{file}"\n')
    with pytest.raises(ScenarioError) as error:
        load_scenario(scenario)
    return str(error.value)


@pytest.mark.parametrize("name", FAULTS)
def test_error_for_an_invalid_waypoint_names_file_row_and_remedy(tmp_path, name):
    content, text = FAULTS[name]
    (tmp_path / "route.csv").write_text(content)
    message = rejection(tmp_path, "route.csv")
    where = "mine.toml: path" if name == "long" else "mine.toml: path.file: route.csv"
    assert message.startswith(f"{where}: ")
    assert any(part in message for part in text.split("|"))
    assert "\n" not in message


def test_binary_waypoint_files_are_rejected(tmp_path):
    (tmp_path / "binary.csv").write_bytes(b"\x93NUMPY\x01\x00\xff\xfe")
    assert "binary.csv: the file is not text" in rejection(tmp_path, "binary.csv")
    (tmp_path / "folder.csv").mkdir()
    assert "folder.csv: is a folder; specify a file" in rejection(tmp_path, "folder.csv")
    assert "nowhere.csv: no such file in " in rejection(tmp_path, "nowhere.csv")
    with (tmp_path / "huge.csv").open("wb") as file:
        file.truncate(MAX_BYTES + 1)
    assert "huge.csv: the file size is 2 MB, but the limit is 2" in rejection(tmp_path, "huge.csv")
    assert "path.file" in rejection(tmp_path, "a" * 5000)


def test_pipes_and_devices_as_waypoint_files_are_rejected(tmp_path):
    os.mkfifo(tmp_path / "pipe.csv")
    (tmp_path / "zero.csv").symlink_to("/dev/zero")
    (tmp_path / "round.csv").symlink_to("round.csv")
    assert "pipe.csv: is not a regular file; specify a file" in rejection(tmp_path, "pipe.csv")
    assert "zero.csv: is not a regular file; specify a file" in rejection(tmp_path, "zero.csv")
    assert "round.csv: no such file in " in rejection(tmp_path, "round.csv")


def test_excessive_waypoint_smoothing_is_rejected(tmp_path):
    file = route(tmp_path, ring(radius=3))
    with pytest.raises(ValueError, match="smoothing_m: 900 m removes the shape of the path"):
        Waypoints(file=file, closed=True, smoothing_m=900, corners="spline").check()


def test_error_for_excessive_path_curvature_names_its_location(tmp_path):
    route(tmp_path, [(0, 0), (10, 0), (20, 0), (20.5, 0.5), (20, 1), (10, 1), (0, 1)])
    message = rejection(tmp_path, "route.csv")
    assert message.startswith("mine.toml: path: the curvature of ")
    place = message.split("at (")[1].split(")")[0].split(", ")
    assert float(place[0]) == pytest.approx(20.5, abs=0.5)
    assert float(place[1]) == pytest.approx(0.5, abs=0.5)
    assert "the limit is 45 deg" in message


def test_invalid_waypoint_file_gives_exit_status_2_and_one_line(tmp_path, monkeypatch, capsys):
    (tmp_path / "route.csv").write_text(GOOD + "nan,0\n")
    scenario = tmp_path / "mine.toml"
    scenario.write_text('[path]\nkind = "waypoints"\nfile = "route.csv"\n')
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.argv", ["agrobot-mj", "run", str(scenario)])
    with pytest.raises(SystemExit) as end:
        main()
    message = capsys.readouterr().err
    assert end.value.code == 2
    assert message.count("\n") == 1
    assert "route.csv: row 4" in message
    assert "Traceback" not in message
