"""Figures and table of a report: content, missing runs, and correct numbers."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from matplotlib import rcParams
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.image import imread

from agrobot_mj.core.signals import Reference
from agrobot_mj.metrics.crosstrack import cross_track
from agrobot_mj.paths import Circle, FigureEight, Line
from agrobot_mj.studies import report, style
from agrobot_mj.studies.compare import legend, table
from agrobot_mj.studies.report import ReportedRun, q, write_figures

NAMES = ["trajectory", "longitudinal_error", "lateral_error", "control_signals", "yaw_rate_error", "q"]
CONTROLLERS = {"pd": 0.5, "pd_isgn": 0.3, "pd_t1fnn": 0.2, "pd_t2fnn": 0.1}
GLOBAL_STYLE = dict(rcParams)
CIRCLE = Circle(radius_m=5, speed_m_s=2)


class RunLog:
    """Log of a tractor `error` to the left of the path and ahead of the reference, with a noisy yaw rate."""

    def __init__(self, path: Any, error: float, controller: str, end_s: float = np.inf) -> None:
        self.scenario = SimpleNamespace(path=path)
        t = np.arange(0, min(end_s, path.duration_s), 0.05)
        r = np.array([path.at(s) for s in t]).reshape(-1, len(Reference._fields))
        noise = np.random.default_rng(0).normal(0, 0.05, len(t))
        network = 0.1 if controller != "pd" else 0.0
        self.columns = {
            "t": t,
            "x": r[:, 0] - error * np.sin(r[:, 4]),
            "y": r[:, 1] + error * np.cos(r[:, 4]),
            "e_lateral": np.full(len(t), -error),
            "e_longitudinal": error * np.sin(t),
            "e_yaw_rate": 0.1 + noise,
            "tau_c": noise,
            "tau_n": np.full(len(t), network),
            "steer_ref": noise - network,
            "q": np.full(len(t), 0.5 if "fnn" in controller else np.nan),
        }

    def column(self, name: str) -> Any:
        return self.columns[name]


def runs(path: Any = CIRCLE, plants: tuple[str, ...] = ("bicycle", "mujoco")) -> list[ReportedRun]:
    return [ReportedRun(p, c, RunLog(path, error, c)) for p in plants for c, error in CONTROLLERS.items()]


def curves(figure: Figure) -> list[Any]:
    """Return all curves of a figure except straight markers."""
    return [line for axes in figure.axes for line in axes.lines if len(line.get_xdata()) > 2]


EIGHT = pytest.param(FigureEight(speed_m_s=5), id="eight", marks=pytest.mark.slow)


@pytest.mark.parametrize("path", [pytest.param(CIRCLE, id="circle"), EIGHT])
def test_each_figure_of_the_paper_is_written_as_a_nonempty_image(path: Any, tmp_path: Path) -> None:
    files = write_figures(runs(path), tmp_path)
    assert [file.name for file in files] == [f"{name}.png" for name in NAMES]
    assert sorted(tmp_path.iterdir()) == sorted(files)
    for file in files:
        pixels = imread(file)
        assert pixels.shape[1] == 2 * 3.5 * 200
        assert pixels[..., :3].std() > 0.05
        assert (pixels[:, [0, -1], :3] == 1).all(), "something is cut off at the sides"
        assert (pixels[[0, -1], :, :3] == 1).all(), "something is cut off above or below"


def test_figure_of_weight_q_on_a_path_without_laps_has_no_legend() -> None:
    figure = q([ReportedRun("bicycle", "pd_t2fnn", RunLog(Line(), 0.1, "pd_t2fnn"))])
    assert figure is not None
    assert curves(figure)
    assert figure.legends == []


def test_plotting_does_not_change_the_global_plot_style(tmp_path: Path) -> None:
    write_figures(runs()[:1], tmp_path)
    assert dict(rcParams) == GLOBAL_STYLE


def test_figures_without_data_are_omitted(tmp_path: Path) -> None:
    files = write_figures([ReportedRun("bicycle", "pd", RunLog(CIRCLE, 0.5, "pd"))], tmp_path)
    assert [file.stem for file in files] == NAMES[:-1]
    assert write_figures([], tmp_path) == []


def test_a_failed_figure_leaves_no_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(canvas: Any, file: Path, **_: Any) -> None:
        file.write_bytes(b"half a picture")
        raise OSError("disk full")

    monkeypatch.setattr(style.FigureCanvasAgg, "print_figure", fail)
    with pytest.raises(OSError, match="disk full"):
        write_figures(runs()[:1], tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_each_controller_has_the_same_colour_in_all_figures() -> None:
    one, colour = runs()[1:2], report.COLOURS["pd_isgn"]
    assert {curve.get_color() for curve in curves(report.lateral_error(one))} == {colour}
    assert {curve.get_color() for curve in curves(report.trajectory(one))} == {colour, "black"}
    own = [ReportedRun("bicycle", name, RunLog(CIRCLE, 0.1, name)) for name in ("mine", "yours", "pd")]
    assert len({c.get_color() for c in curves(report.lateral_error(own))}) == 3


def test_laws_have_distinct_colours_and_display_names() -> None:
    laws = ("stanley", "lqr", "pure_pursuit", "nmpc", "pi", "mine", "yours")
    figure = report.trajectory([ReportedRun("bicycle", name, RunLog(CIRCLE, 0.1, name)) for name in laws])
    names = [text.get_text() for text in figure.legends[0].get_texts()]
    assert names[3:8] == ["Stanley", "LQR", "pure pursuit", "NMPC", "PI"]
    colours = [to_rgb(str(line.get_color())) for line in figure.legends[0].get_lines()[3:]]
    assert len(set(colours)) == len(laws)
    assert all(np.ptp(colour) > 0.1 for colour in colours), "grey is close to the black reference"


def test_plotted_lateral_error_is_positive_left_of_the_path() -> None:
    log = RunLog(CIRCLE, 0.1, "pd")
    (curve,) = curves(report.lateral_error([ReportedRun("bicycle", "pd", log)]))
    np.testing.assert_allclose(curve.get_ydata(), 0.1)
    beside = cross_track(CIRCLE, *(log.column(name) for name in ("t", "x", "y")))
    np.testing.assert_allclose(beside, 0.1, atol=1e-3)


def test_track_is_dotted_in_the_first_lap_and_solid_in_later_laps() -> None:
    figure = report.trajectory(runs()[:1])
    tracks = {c.get_linestyle(): c for c in figure.axes[0].lines if c.get_color() != "black"}
    log = runs()[0].log
    first = log.column("t") <= CIRCLE.turns_s[0][1]
    assert tracks[":"].get_xdata() == pytest.approx(log.column("x")[first])
    assert tracks["-"].get_ydata() == pytest.approx(log.column("y")[~first])
    assert figure.axes[0].get_aspect() == 1
    straight = report.trajectory([ReportedRun("bicycle", "pd", RunLog(Line(), 0.1, "pd"))])
    assert all(c.get_linestyle() != ":" or len(c.get_xdata()) == 0 for c in straight.axes[0].lines)


def test_enlarged_trajectory_section_shows_the_maximum_error() -> None:
    log = RunLog(CIRCLE, 0.0, "pd")
    worst = 150
    log.columns["e_lateral"][worst] = 0.7
    x, y = CIRCLE.at(0.05 * worst)[:2]
    low, high = report.trajectory([ReportedRun("bicycle", "pd", log)]).axes[1].viewLim.get_points()
    assert low[0] < x < high[0]
    assert low[1] < y < high[1]


def test_control_signal_figure_shows_terms_of_network_controllers_only() -> None:
    figure = report.control_signals(runs(plants=("bicycle",)))
    assert len(figure.axes) == 3
    command, tau_c, tau_n = (figure.axes[0].lines[k].get_ydata() for k in (0, 2, 4))
    assert command == pytest.approx(tau_c + tau_n)
    assert tau_n == pytest.approx(np.degrees(-0.1))


def test_diverged_run_does_not_hide_other_runs_in_a_figure(tmp_path: Path) -> None:
    compared = runs(plants=("mujoco",))
    lost = RunLog(CIRCLE, 0.1, "pd_t2fnn", end_s=12.0)
    lost.columns["e_lateral"][-20:] = np.geomspace(1, 1e30, 20)
    lost.columns["x"][-2:] = np.nan, np.inf
    lost.columns["e_yaw_rate"][-2:] = np.nan, 1e300
    compared[-1] = ReportedRun("mujoco", "pd_t2fnn", lost)
    low, high = report.lateral_error(compared).axes[0].get_ylim()
    assert -0.1 < low < high < 0.6
    assert len(write_figures(compared, tmp_path)) == len(NAMES)


@pytest.mark.parametrize("end_s", [0.0, 0.04, 0.3])
def test_run_of_zero_to_six_ticks_can_be_plotted(end_s: float, tmp_path: Path) -> None:
    short = [ReportedRun("mujoco", "pd_t2fnn", RunLog(CIRCLE, 0.1, "pd_t2fnn", end_s))]
    assert write_figures(short, tmp_path)


def row(plant: str, controller: str, mse: float | None, seed: int = 0, turns: int = 2) -> dict[str, Any]:
    per_turn = [{"turn": k + 1, "complete": k < turns, "lateral_mse": (mse or 0) + k} for k in range(2)]
    numbers = {"lateral_mse": mse, "xte_rms": 0.1234, "per_turn": per_turn, "nn_share": [0.25, 0.75]}
    return {"plant": plant, "controller": controller, "seed": seed, "outcome": "completed", **numbers}


def cells(text: str) -> list[list[str]]:
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in text.splitlines()]


def test_comparison_table_contains_the_metric_values() -> None:
    text = table([row("bicycle", "pd", 0.5), row("bicycle", "pd_t2fnn", 0.2), row("mujoco", "pd", 0.4)])
    head, _, first, second, third = cells(text)
    assert head[:4] == ["plant", "controller", "outcome", "lateral MSE [m2]"]
    assert first[3:] == ["0.500", "0.500", "1.50", "1.00", "0.123", "0.250", "0.750"]
    assert second[:3] == ["bicycle", "pd_t2fnn", "completed"]
    assert second[3:] == ["0.200", "0.200", "1.20", "0.40", "0.123", "0.250", "0.750"]
    assert third[6] == "1.00"


def test_missing_values_are_shown_as_dashes() -> None:
    early = cells(table([row("mujoco", "pd_isgn", None, turns=1), row("mujoco", "pd", 3e7, turns=0)]))
    assert early[0][3:] == ["lateral MSE [m2]", "turn 1", "/ pd", "xte rms [m]", "nn 1"]  # others hold nothing
    assert early[2][3:] == ["-", "0.00", "-", "0.123", "0.250"]
    assert early[3][3:] == ["3.0e+07", "-", "1.00", "0.123", "-"]
    assert "/ pd" not in cells(table([row("mujoco", "pd_t2fnn", 0.5)]))[0]
    assert "nn 1" not in cells(table([row("mujoco", "pd", 0.5) | {"nn_share": [0.0, 0.0]}]))[0]


def test_small_errors_in_the_table_have_three_significant_digits() -> None:
    assert cells(table([row("mujoco", "pd", 1.2345e-5)]))[2][3] == "1.23e-05"
    assert cells(table([row("mujoco", "pd", 3.456e-4)]))[2][3] == "0.000346"


def test_table_of_a_single_lap_path_has_no_lap_columns() -> None:
    hedge = row("mujoco", "pd", 0.5)
    hedge |= {"per_turn": hedge["per_turn"][:1], "nn_share": [0.25]}
    assert cells(table([hedge]))[0][3:] == ["lateral MSE [m2]", "/ pd", "xte rms [m]", "nn 1"]
    assert "turn 1" in cells(table([hedge, row("mujoco", "pd", 0.5)]))[0]


def test_controller_column_is_in_the_table_if_any_run_has_a_controller() -> None:
    law = row("mujoco", "pd", 0.5) | {"controller": None, "guidance": "lqr"}
    assert "controller" not in cells(table([law, law | {"guidance": "stanley"}]))[0]
    assert "controller" in cells(table([law, row("mujoco", "pd", 0.5) | {"guidance": "kinematic"}]))[0]


def test_comparison_table_legend_explains_exactly_the_table_columns() -> None:
    text = table([row("mujoco", "pd_isgn", None, turns=1), row("mujoco", "pd", 3e7, turns=0)])
    assert [line.partition("  ")[0] for line in legend(text)] == cells(text)[0][3:]


def test_each_seed_has_a_separate_table_row_and_error_ratio() -> None:
    runs_of = ((1, "pd", 1), (1, "x", 2), (2, "pd", 4), (2, "x", 2))
    lines = cells(table([row("mujoco", controller, mse, seed) for seed, controller, mse in runs_of]))[2:]
    assert [line[2] for line in lines] == ["1", "1", "2", "2"]
    assert [line[7] for line in lines] == ["1.00", "2.00", "1.00", "0.50"]


def test_table_is_plain_ascii_even_if_colour_is_forced(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("COLUMNS", "20")
    text = table([row("bicycle", "pd[bold]", 0.5)])
    assert text.isascii()
    assert "\x1b" not in text
    assert "pd[bold]" in text
    assert len({len(line) for line in text.splitlines()}) == 1
