"""Inputs of excessive size are rejected immediately, with a short message."""

import pytest

from agrobot_mj import load_scenario
from agrobot_mj.core.errors import LONGEST_TEXT, MOST_FAULTS, MOST_LINES, ScenarioError, shorten_lines
from agrobot_mj.studies.sweep.axes import MOST_VALUES
from agrobot_mj.studies.sweep.runner import SweepOptions, sweep


def refused(tmp_path, content, name="huge.toml", **options):
    """Return the error message for a sweep file."""
    (tmp_path / name).write_text(content, encoding="utf-8")
    with pytest.raises(ScenarioError) as error:
        sweep(tmp_path / name, tmp_path / "out", SweepOptions(quiet=True, jobs=1, **options))
    assert not (tmp_path / "out").exists()
    return str(error.value)


@pytest.mark.parametrize(
    ("axis", "expected"),
    [
        ("{ from = 5.5, to = 7.5, step = 1e-280 }", "step: gives more than 1e+15 values from 5.5 to 7.5"),
        ("{ from = 5.5, to = 7.5, step = 1e-322 }", "step: gives more than 1e+15 values"),
        ("{ from = -9e307, to = 9e307, step = 0.001 }", "step: gives more than 1e+15 values"),
        (f"{{ from = 2, to = {10**40}, step = 3 }}", "step: gives more than 1e+15 values"),
        ("{ from = 5.5, to = 7.5, step = 1e-400 }", "never leads from 5.5 to 7.5"),
        ("{ from = 5.5, to = 7.5, count = 700_000_000 }", "2,100,000,000 runs (700,000,000 path.radius_m x 3 seeds)"),
        (f"{{ from = 5.5, to = 7.5, count = {10**19} }}", "count: must be at most 1e+15"),
        (f"{{ from = 5.5, to = 7.5, count = {MOST_VALUES} }}", "1,000,000,000,000,000 path.radius_m x 3 seeds"),
    ],
)
def test_excessively_large_sweep_axes_are_rejected(axis, expected, tmp_path):
    content = f'base = "circle"\nseeds = 3\n[axes]\n"path.radius_m" = {axis}\n'
    assert expected in refused(tmp_path, content, max_runs=7)


@pytest.mark.parametrize(
    "content", ["seeds = 1_500_000_000", 'samples = 90_000_000\ndraws."seed2" = {uniform = [1, 2]}']
)
def test_excessive_numbers_of_seeds_and_samples_are_rejected(content, tmp_path):
    assert "the limit is 7" in refused(tmp_path, f'base = "circle"\n{content}\n', max_runs=7)


@pytest.mark.parametrize("file", ["scenario", "machine", "sweep"])
def test_error_lists_the_first_of_many_unknown_keys(file, tmp_path):
    keys = "".join(f"wheelbas_{k} = 2\n" for k in range(7000))
    if file == "sweep":
        message = refused(tmp_path, f'base = "circle"\n{keys}')
    else:
        (tmp_path / "s.toml").write_text(f"[tractor]\n{keys}", encoding="utf-8")
        with pytest.raises(ScenarioError) as error:
            load_scenario(
                *((tmp_path / "s.toml",) if file == "scenario" else ("circle", {"machine": str(tmp_path / "s.toml")}))
            )
        message = str(error.value)
    lines = message.split("\n")
    assert len(lines) == MOST_FAULTS + 1
    assert all("unknown key" in line for line in lines[:-1])
    assert lines[-1].endswith(f": and {7000 - MOST_FAULTS:,} more errors")
    assert len(message) < LONGEST_TEXT


def test_error_message_lists_all_errors_up_to_a_limit(tmp_path):
    keys = "".join(f"wheelbas_{k} = 2\n" for k in range(MOST_FAULTS))
    (tmp_path / "s.toml").write_text(f"[tractor]\n{keys}", encoding="utf-8")
    with pytest.raises(ScenarioError) as error:
        load_scenario(tmp_path / "s.toml")
    assert "more errors" not in str(error.value)
    assert str(error.value).count("unknown key") == MOST_FAULTS


@pytest.mark.parametrize(
    ("text", "lines"),
    [("\n".join(["short"] * 5000), MOST_LINES + 1), ("\n".join(["x" * 9000] * 50), None), ("y" * 10**6, 1)],
)
def test_length_of_an_error_message_is_limited(text, lines):
    found = str(ScenarioError(text))
    assert len(found) <= LONGEST_TEXT
    assert lines is None or len(found.split("\n")) == lines
    if "\n" in text:
        assert f"and {len(text.splitlines()) - len(found.splitlines()) + 1:,} more lines" in found
    assert shorten_lines(found) == found


def test_error_message_of_ordinary_length_is_not_shortened():
    text = "\n".join(f"s.toml: key_{k}: is wrong" for k in range(MOST_LINES))
    assert str(ScenarioError(text)) == text
