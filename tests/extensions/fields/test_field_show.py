"""Command `field show`: description of a field, its map, and messages."""

import json
import math

import pytest

pytest.importorskip("shapely")

TEXT = "x,y\n0,0\n100,0\n100,100\n50,20\n0,100\n0,100\n"
"""Field of 0.6 ha with a notch and a repeated point."""


@pytest.fixture
def file(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "home.csv").write_text(TEXT)
    return "home.csv"


def test_field_show_prints_area_corners_and_repairs(call, file, tmp_path):
    status, out, err = call("field", "show", file, "--out", "found")
    assert (status, err) == (0, "")
    first, corners, problem, picture = out.splitlines()
    assert first == "home: 0.6 ha, perimeter 489 m"
    assert corners == "5 sharp corners of up to 148 deg at (100.0, 100.0) m"
    assert problem == "problem: 1 repeated point of the boundary is omitted"
    assert picture == "found/map.png"
    assert (tmp_path / "found" / "map.png").read_bytes().startswith(b"\x89PNG")


def test_field_show_prints_a_single_sharp_corner_in_singular(call, file, tmp_path):
    angle = [0.1 * k for k in range(32)]
    drop = [(0.0, -90.0), *((50 * math.cos(a), 50 * math.sin(a)) for a in angle)]
    (tmp_path / "drop.csv").write_text("x,y\n" + "\n".join(f"{x:.2f},{y:.2f}" for x, y in drop))
    _, out, _ = call("field", "show", "drop.csv", "--out", "found")
    assert out.splitlines()[1] == "1 sharp corner of 122 deg at (0.0, -90.0) m"


def test_field_show_prints_a_json_document_on_success_and_failure(call, file):
    status, out, _ = call("field", "show", file, "--json")
    document = json.loads(out)
    assert (status, document["command"], document["area_m2"]) == (0, "field show", pytest.approx(6000))
    assert document["folder"] == "runs/field-home"
    status, out, err = call("field", "show", "nowhere.csv", "--json")
    document = json.loads(out)
    assert (status, document["command"], document["error"]) == (2, "field show", err.strip())
    assert err == "nowhere.csv: no such file; specify an existing file\n"


def test_field_command_without_a_subcommand_lists_the_subcommands(call):
    status, _, err = call("field")
    assert status == 2
    assert "field: specify one of its commands: field show" in err


def test_help_of_the_field_command_describes_its_subcommands(call):
    status, out, err = call("field", "--help")
    assert (status, err) == (0, "")
    assert [line[:12].rstrip() for line in out.splitlines()] == ["field show", "field plan", "field run"]
    assert "Plan headland laps, swaths and turns" in out


def test_field_command_writes_nothing_for_an_invalid_file(call, file, tmp_path):
    (tmp_path / file).write_text("x,y\n0,0\n")
    status, out, err = call("field", "show", file, "--out", "found")
    need = "the boundary needs at least 3 different points, got 1; add its corners"
    assert (status, out, err) == (2, "", f"home.csv: {need}\n")
    assert not (tmp_path / "found").exists()


@pytest.mark.parametrize("arguments", [("show", ""), ("plan", "  "), ("run", "home.csv", "--plan", "")])
def test_blank_field_file_name_is_rejected(call, file, arguments):
    status, out, err = call("field", *arguments)
    assert (status, out) == (2, "")
    assert "an argument is blank" in " ".join(err.split())


def test_incomplete_price_is_rejected_before_planning(call, file):
    assert call("field", "run", file, "--price", "seed=3")[::2] == (
        2,
        "--price seed=3: the name must be one of input_ha, yield_ha, hour; the value must be at least 0\n",
    )
