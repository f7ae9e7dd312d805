"""Command `field compare`: worked area recorded by AgOpenGPS next to the true worked area of a run."""

import json

import numpy as np
import pyarrow.parquet as pq
import pytest

pytest.importorskip("shapely")

from linked import COLOUR, START, farm, linked_run, strip_rows
from removed import is_there
from shapely import Polygon, affinity, box

from agrobot_mj.core.agopengps.messages import SteerData
from agrobot_mj.core.agopengps.wire import encode
from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.extensions.fields.field import Field
from agrobot_mj.extensions.fields.recorded_work import comparison, recorded_strips, work_of_run

WIDTH = 3.0
LEFT, BOTH = 0b01, 0b11  # Bit masks of the sections; section 1 is on the left


def straight(west, east, south, north, step=5.0):
    """Return the points of a strip along the x axis, driven to the east."""
    x = np.append(np.arange(west, east, step), east)
    return np.stack([np.column_stack([x, np.full(len(x), y)]) for y in (north, south)], axis=1).reshape(-1, 2)


def sections_file(folder, text):
    (folder / "Sections.txt").write_text(text, newline="")
    return folder / "Sections.txt"


def test_overlap_of_two_strips_equals_the_overlap_of_rectangles(tmp_path):
    text = strip_rows(straight(0, 100, 0, 3)) + strip_rows(straight(20, 90, 2.4, 5.4))
    strips = recorded_strips(sections_file(tmp_path, text))
    found = comparison(Field("f", box(0, 0, 100, 6)), strips, [box(0, 0, 100, 3), box(0, 3, 50, 6)]).numbers()
    host, true = found["areas"]["host"], found["areas"]["true"]
    assert host["worked_m2"] == pytest.approx(100 * 3 + 70 * 3 - 70 * 0.6)
    assert host["overlapped_m2"] == pytest.approx(70 * 0.6)
    assert host["missed_m2"] == pytest.approx(600 - 468)
    assert (true["worked_m2"], true["overlapped_m2"]) == pytest.approx((450, 0), abs=1e-9)
    assert found["recorded_only_m2"] == pytest.approx(40 * 2.4)  # x from 50 to 90, y from 3 to 5.4
    assert found["worked_only_m2"] == pytest.approx(20 * 3 + 30 * 0.6)  # west of 20, and y above 5.4 up to x = 50


def test_strip_in_a_tight_bend_counts_its_own_overlap_once(tmp_path):
    angle = np.linspace(0, 2 * np.pi, 41)
    left = np.column_stack([-1.0 * np.cos(angle), -1.0 * np.sin(angle)])  # the left edge passes the centre of the bend
    right = np.column_stack([2.0 * np.cos(angle), 2.0 * np.sin(angle)])
    (area,) = recorded_strips(sections_file(tmp_path, strip_rows(np.stack([left, right], axis=1).reshape(-1, 2))))
    assert area.area == pytest.approx(4 * np.pi, rel=0.01)
    assert area.is_valid


def test_strip_with_an_odd_number_of_points_ends_with_a_triangle(tmp_path):
    (area,) = recorded_strips(sections_file(tmp_path, strip_rows([(0, 1), (0, 0), (2, 1), (2, 0), (3, 1)])))
    assert area.equals(Polygon([(0, 1), (0, 0), (2, 0), (3, 1)]))


def test_strip_along_its_own_front_has_no_line_as_a_part(tmp_path):
    """The first quadrilateral has no area, because both edges move along the line between them."""
    points = [(0, 1), (0, 0), (0, 3), (0, 2), (2, 1), (2, 0)]
    (area,) = recorded_strips(sections_file(tmp_path, strip_rows(points)))
    assert area.equals(Polygon([(0, 3), (2, 1), (2, 0), (0, 2)]))


def test_decimal_commas_and_other_lines_of_recorded_work_are_read(tmp_path):
    text = "Sections\r\n\r\n" + strip_rows([(0.5, 1), (0.5, 0), (2.5, 1), (2.5, 0)]).replace(",", ";").replace(
        ".", ","
    ).replace(";", ",")
    (area,) = recorded_strips(sections_file(tmp_path, text))
    assert area.area == pytest.approx(2.0)


BAD = {
    "empty": ("", "contains no worked area"),
    "agshare": ("Sections\r\n0\r\n", "contains no worked area"),
    "short": ("9\r\n27,151,160\r\n0,0,0\r\n", "line 1: the strip has 9 rows, but the file ends before"),
    "words": (f"3\r\n{COLOUR}\r\n0,0,0\r\nx,y,z\r\n", "line 4: 'x,y,z' is not a position"),
    "nan": (f"3\r\n{COLOUR}\r\n0,0,0\r\nnan,1,0\r\n", "line 4: 'nan,1,0' is not a position"),
    "far": (f"3\r\n{COLOUR}\r\n0,0,0\r\n1e300,1,0\r\n", "line 4: '1e300,1,0' is not a position"),
    "line": (strip_rows([(0, 0), (0, 0), (5, 0), (5, 0)]), "contains no worked area"),
}


@pytest.mark.parametrize("name", BAD)
def test_unusable_recorded_work_is_rejected_with_the_fix(tmp_path, name):
    text, message = BAD[name]
    with pytest.raises(ScenarioError, match=r"^Sections\.txt: ") as error:
        recorded_strips(sections_file(tmp_path, text))
    assert message in str(error.value)


def states(t):
    """Return the bit mask of the sections at a time [s]."""
    return BOTH if 5.0 <= t < 15.0 else LEFT if 15.0 <= t < 20.0 else 0


@pytest.fixture(scope="module")
def driven(tmp_path_factory):
    """Return the folder of a link run, whose host steers straight ahead and switches two sections, and the field."""
    if not is_there("link"):
        pytest.skip("without the extension links")
    folder = tmp_path_factory.mktemp("link") / "link"
    linked_run(folder, 24, states)
    farm(folder / "Farm")
    return folder


def positions(folder):
    """Return time [s] and position of the implement [m] in the plane of the host, from the signals of the run."""
    table = pq.read_table(folder / "run" / "signals.parquet", columns=["t", "x", "y", "yaw"])
    t, x, y, yaw = (np.asarray(table[name].to_numpy(), dtype=float) for name in ("t", "x", "y", "yaw"))
    assert np.abs(yaw).max() < 1e-3
    return t, x + 40.0, y + 25.0


def test_true_work_of_a_link_run_follows_the_section_states_of_the_host(driven):
    t, x, y = positions(driven)
    found = work_of_run(driven / "run", START, WIDTH, 2)
    first, middle, last = np.interp([5.0, 15.0, 20.0], t, x)
    area = WIDTH * (middle - first) + WIDTH / 2 * (last - middle)
    assert sum(each.area for each in found.passes) == pytest.approx(area, rel=0.01)
    assert found.notes == ()
    one_sided = found.passes[-1].bounds
    assert one_sided[3] - one_sided[1] == pytest.approx(WIDTH / 2, abs=0.01)
    assert one_sided[1] == pytest.approx(y[-1], abs=0.02)  # the left half


def test_field_compare_reports_a_strip_recorded_beside_the_true_strip(driven, call, tmp_path):
    passes = work_of_run(driven / "run", START, WIDTH, 2).passes
    t, x, _ = positions(driven)
    west, south, _, north = passes[0].bounds
    east = passes[-1].bounds[2]
    sections_file(driven / "Farm", strip_rows(straight(west, east, south + 0.2, north + 0.2, step=1.0)))
    words = ("field", "compare", driven / "run", driven / "Farm", "--width", WIDTH, "--out", tmp_path / "out")
    status, out, err = call(*words)
    assert (status, err) == (0, "")
    content = json.loads((tmp_path / "out" / "recorded.json").read_text())
    true, host = content["areas"]["true"], content["areas"]["host"]
    assert host["worked_m2"] == pytest.approx(WIDTH * (east - west), rel=1e-3)
    assert true["worked_m2"] == pytest.approx(sum(each.area for each in passes), rel=1e-6)
    assert content["worked_only_m2"] == pytest.approx(0.2 * np.diff(np.interp([5.0, 15.0], t, x))[0], rel=0.02)
    assert host["worked_m2"] - content["recorded_only_m2"] == pytest.approx(
        true["worked_m2"] - content["worked_only_m2"]
    )
    assert f"worked      {true['worked_m2']:12.1f}{host['worked_m2']:12.1f}" in out.splitlines()
    assert (tmp_path / "out" / "recorded.png").read_bytes().startswith(b"\x89PNG")


def test_all_sections_work_while_a_host_steers_without_switching_them(driven, tmp_path):
    table = pq.read_table(driven / "run" / "link.parquet")
    silent = encode(SteerData(1.5, 1, 0.0, 255, 0))
    way, data = (table[name].to_pylist() for name in ("direction", "bytes"))
    data = [silent if way == "in" else each for way, each in zip(way, data, strict=True)]
    index = table.schema.get_field_index("bytes")
    (tmp_path / "run").mkdir()
    for name in ("signals.parquet", "scenario.toml"):
        (tmp_path / "run" / name).write_bytes((driven / "run" / name).read_bytes())
    pq.write_table(table.set_column(index, table.schema.field("bytes"), [data]), tmp_path / "run" / "link.parquet")
    found = work_of_run(tmp_path / "run", START, WIDTH, None)
    t, x, _ = positions(driven)
    assert sum(each.area for each in found.passes) == pytest.approx(WIDTH * (x[-1] - x[0]), rel=0.02)
    assert found.notes == ("the host sent no section states, so all sections are counted as on while the host steers",)


def test_a_number_of_sections_below_the_highest_in_use_is_rejected(driven):
    with pytest.raises(ScenarioError, match=r"^--sections 1: the host switches section 2; specify at least 2$"):
        work_of_run(driven / "run", START, WIDTH, 1)


def test_work_outside_the_field_is_rejected_with_its_distance():
    field, inside, outside = Field("home", box(0, 0, 100, 6)), box(0, 0, 50, 3), box(150, 0, 200, 3)
    with pytest.raises(ScenarioError, match=r"^home: the work in Sections\.txt is 50 m away from the field; specify"):
        comparison(field, [outside], [inside])
    with pytest.raises(ScenarioError, match=r"^home: the work of the run is 50 m away from the field; compare"):
        comparison(field, [inside], [outside])
    assert comparison(field, [inside, outside], []).numbers()["recorded_only_m2"] == pytest.approx(150)


def test_rounding_does_not_cause_a_negative_overlap():
    """Each pass is a turned strip, so that the sum of the areas and the area of the union differ by rounding."""
    passes = [affinity.rotate(box(0, 3 * k, 50, 3 * k + 3), 0.1, origin=(0, 0)) for k in range(9)]
    found = comparison(Field("home", box(-5, -5, 60, 40)), passes, passes).numbers()["areas"]["true"]
    assert 0.0 <= found["overlapped_m2"] < 1e-9


def test_field_compare_rejects_other_folders_with_the_fix(driven, call, tmp_path):
    (tmp_path / "run").mkdir()
    sections_file(driven / "Farm", strip_rows(straight(0, 10, 0, 3)))
    status, _, err = call("field", "compare", tmp_path / "run", driven / "Farm")
    assert (status, "link.parquet: no such file; specify the folder of a run of the command link" in err) == (2, True)
    (driven / "Farm" / "Sections.txt").unlink()
    status, _, err = call("field", "compare", driven / "run", driven / "Farm")
    assert (status, "Sections.txt: no such file; specify the folder of a field with recorded work" in err) == (2, True)
