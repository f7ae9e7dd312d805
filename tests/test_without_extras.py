"""Commands in an installation without the extras for recordings, figures and filters."""

import pytest
from processes import bare

from agrobot_mj.core.errors import missing_extra
from agrobot_mj.studies import compare, report

LEFT_OUT = ("rerun", "rerun_bindings", "matplotlib", "contourpy", "filterpy", "plotly", "shapely")
START = "import sys; sys.modules.update(dict.fromkeys({!r})); from agrobot_mj.cli import main; main()"
SHORT = ("--set", "duration_s=1", "--set", "plant.kind=bicycle")
RECORDING = 'no recording: rerun-sdk is not installed; pip install "agrobot-mj[recording]"'
FIGURES = 'no figures: matplotlib is not installed; pip install "agrobot-mj[report]"'


@pytest.fixture
def lean(tmp_path):
    """Return a function that runs a command in `tmp_path` in a process that cannot import the optional libraries."""

    def call(*arguments, left_out=LEFT_OUT):
        return bare(tmp_path, "-c", START.format(left_out), *arguments)

    return call


def test_run_without_extras_prints_one_line_and_writes_no_recording(lean, tmp_path):
    done = lean("run", "circle", *SHORT, "--out", "one", "--quiet")
    assert (done.returncode, done.stderr.splitlines()) == (0, [RECORDING])
    names = {path.name for path in (tmp_path / "one").iterdir()}
    assert {"signals.parquet", "metrics.json", "scenario.toml"} <= names
    assert "run.rrd" not in names
    asked_for = lean("run", "circle", *SHORT, "--no-rrd", "--out", "two", "--quiet")
    assert (asked_for.returncode, asked_for.stderr) == (0, "")


def test_comparison_without_extras_has_result_rows_but_no_figures(lean, tmp_path):
    arguments = ("compare", "circle", "--controllers", "pd", "--plants", "bicycle", *SHORT[:2], "--jobs", "1")
    done = lean(*arguments, "--out", "both", "--quiet")
    assert (done.returncode, done.stderr.splitlines()) == (0, [RECORDING, FIGURES])
    assert (tmp_path / "both/comparison.json").is_file()
    assert not [path for path in (tmp_path / "both").rglob("*") if path.suffix in (".png", ".rrd")]
    again = lean(*arguments, "--out", "both", "--quiet")
    assert again.returncode == 0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("view", "run.rrd", "--web"), 'a recording needs rerun; pip install "agrobot-mj[recording]"'),
        (("snapshot", "run.rrd"), 'a recording needs rerun; pip install "agrobot-mj[recording]"'),
        (("run", "circle", *SHORT, "--live"), 'a recording needs rerun; pip install "agrobot-mj[recording]"'),
        (("field", "show", "run.rrd"), 'field show needs shapely; pip install "agrobot-mj[fields]"'),
        (("field", "plan", "run.rrd"), 'field work needs shapely; pip install "agrobot-mj[fields]"'),
        (("field", "run", "run.rrd"), 'field work needs shapely; pip install "agrobot-mj[fields]"'),
        (("rig", "linear", "--out", "rig"), 'a figure needs matplotlib; pip install "agrobot-mj[report]"'),
        (
            ("run", "circle", *SHORT, "--no-rrd", "--set", "estimator.kind=ukf", "--out", "ukf"),
            'estimator.kind = "ukf" needs filterpy; pip install "agrobot-mj[filters]"',
        ),
    ],
)
def test_command_that_needs_an_extra_prints_its_pip_command(lean, tmp_path, arguments, message):
    (tmp_path / "run.rrd").write_bytes(b"RRF2")
    done = lean(*arguments)
    assert done.returncode == 2, done.stderr
    assert done.stderr.splitlines()[-1] == message
    assert "Traceback" not in done.stderr
    assert [path.name for path in tmp_path.rglob("*") if path.is_file() and not path.name.startswith(".")] == [
        "run.rrd"
    ]


def test_error_for_other_missing_modules_names_no_extra():
    assert missing_extra(ModuleNotFoundError("No module named 'mine'", name="mine")) == ""


def test_figures_have_the_names_of_the_functions_that_draw_them():
    assert list(compare.FIGURES) == [draw.__name__ for draw in report.FIGURES]
