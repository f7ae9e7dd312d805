"""Hostile text: thousands of digits and brackets, bytes that are not text, and terminal control characters in names."""

import os
import subprocess
import sys
from io import StringIO
from pathlib import Path

import pytest
from rich.console import Console

from agrobot_mj import cli, load_scenario
from agrobot_mj.cli.options import overrides, results_folder
from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.simulation import progress

DIGITS = "9" * 5000
HEX = "0x" + "f" * 5000


def refused(call, *arguments):
    with pytest.raises(ScenarioError) as error:
        call(*arguments)
    assert len(str(error.value)) < 3000
    return str(error.value)


@pytest.mark.parametrize("text", [f"seed={DIGITS}", "seed=" + "[" * 3000, "seed=" + "{a=" * 3000])
def test_override_with_too_many_digits_or_brackets_is_rejected(text):
    assert "too many digits or brackets" in refused(overrides, [text])


def test_override_with_more_than_one_value_is_rejected():
    assert "the text contains more than one value" in refused(overrides, ["seed=1\nv2=3"])


def test_kind_given_as_number_with_thousands_of_digits_is_rejected():
    assert "thousands of digits" in refused(load_scenario, "circle", {"path.kind": int(HEX, 16)})


def test_list_item_with_thousands_of_digits_is_rejected():
    assert "fault" in refused(load_scenario, "gusts", {f"fault.{DIGITS}.start_s": 1})


@pytest.mark.parametrize("text", [f"seed = {DIGITS}", f"seed = {HEX}", f"[tractor]\nmass_kg = {HEX}"])
def test_file_containing_a_number_with_thousands_of_digits_is_rejected(tmp_path, text):
    (tmp_path / "many.toml").write_text(text)
    assert refused(load_scenario, tmp_path / "many.toml").startswith("many.toml: ")


def test_scenario_file_that_is_not_utf_8_is_rejected():
    assert refused(overrides, [os.fsdecode(b'name="\xff"')]).startswith("--set 'name=")
    assert "the text is not valid UTF-8" in refused(overrides, [os.fsdecode(b"title=\xff")])
    assert "--out 'o\\udcff': the text is not valid" in refused(results_folder, Path(os.fsdecode(b"o\xff")), "x")
    assert "not valid UTF-8" in refused(load_scenario, "circle", {"title": "\udcff"})
    assert overrides(["title=ünï"]) == {"title": "ünï"}
    assert overrides(["title=ünï".encode().decode("ascii", "surrogateescape")]) == {"title": "ünï"}  # LC_ALL=C


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="names of files are bytes on Linux only")
def test_undecodable_characters_of_a_scenario_file_name_are_replaced(tmp_path):
    path = tmp_path / os.fsdecode(b"w\xfcrfel\n.toml")
    path.write_text("duration_s = 1")
    assert load_scenario(path).name == "w_rfel_"


@pytest.mark.parametrize("key", ["name", "title"])
@pytest.mark.parametrize("text", ["\x1b]0;pwn\x07", "a\nb", "\u202egnp"])
def test_name_with_terminal_control_characters_is_rejected(key, text):
    assert f"{key}: must be one line of printable characters" in refused(load_scenario, "circle", {key: text})
    assert load_scenario("circle", {key: "Größe\u00a0[m]"})


def test_long_keys_and_values_are_shortened_in_messages():
    for changes in ({"x" * 50_000: 1}, {"seed": "y" * 5000}, {"path.kind": "z" * 5000}, {"a." * 20_000 + "b": 1}):
        assert len(refused(load_scenario, "circle", changes)) < 2500
    assert "(5002 characters)" in refused(load_scenario, "circle", {"seed": "y" * 5000})


@pytest.mark.parametrize("name", ["[/x]", "[link=http://example.com]y[/link]"])
def test_scenario_name_is_not_interpreted_as_markup(monkeypatch, name):
    written = StringIO()
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    monkeypatch.setattr("rich.console.Console", lambda **_: Console(file=written, force_terminal=True, width=100))
    with progress.tally(name, 1) as advance:
        advance()
    assert name in written.getvalue()


def test_non_ascii_names_are_escaped_on_an_ascii_terminal(tmp_path):
    environment = {**os.environ, "PYTHONPATH": str(Path(cli.__file__).parents[2]), "PYTHONIOENCODING": "ascii"}
    sets = ("name=wüste", "duration_s=1", "plant.kind=bicycle")
    command = [sys.executable, "-m", "agrobot_mj", "run", "circle", "--no-rrd", "--out", str(tmp_path / "out")]
    command += [word for text in sets for word in ("--set", text)]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert "w\\xfcste: completed" in done.stdout
