import numpy as np
import pytest
import rerun as rr
from recorded import Recorded, replay

from agrobot_mj import load_scenario, run
from agrobot_mj.core.signals import Column
from agrobot_mj.recording import Recording, recorder, write_comparison
from agrobot_mj.recording.blueprint import COMPANIONS, FOLLOWED, MOST_PLOTS, TABS, Shown, blueprint
from agrobot_mj.recording.info import running
from agrobot_mj.recording.plots.catalogue import COMPARED, DRIVE, PLOTS, estimation_errors, reported_plots
from agrobot_mj.recording.plots.network import network_plots
from agrobot_mj.recording.plots.signals import Signals

DEG = 180 / np.pi
WHEELS = ("fl", "fr", "rl", "rr")
RULES = [f"{i}_{j}" for i in range(3) for j in range(3)]
UNITS = {
    **{"cm": ("m", 100), "kN": ("N", 1e-3), "%": ("-", 100), "l/min": ("m3/s", 6e4), "bar": ("Pa", 1e-5)},
    **{"deg": ("rad", DEG), "deg/s": ("rad/s", DEG), "deg/s2": ("rad/s2", DEG)},
}
"""Unit in the log and conversion factor of each plot unit that differs from the unit in the log."""
NEGATIVE = ("e_longitudinal", "e_lateral", "tau_n")  # Columns that a plot shows with the opposite sign


def scalars(recorded, path):
    times, values = recorded.column(f"/plots/{path}", "Scalars:scalars")
    return times, np.array(values)


def names(recorded, path):
    return recorded.static(f"/plots/{path}", "SeriesLines:names")


def check_plot(recorded, signals, plot):
    """Check that the times and values of a plot equal the times and values of its log columns."""
    columns, every = [series.column for series in plot.series], slice(None, None, plot.every)
    expected = np.array([signals[name][every] * (-1 if name in NEGATIVE else 1) for name in columns])
    there = np.isfinite(expected).all(axis=0)
    times, values = scalars(recorded, plot.path)
    np.testing.assert_array_equal(times, np.rint(signals["t"][every][there] * 1e9))
    np.testing.assert_allclose(values.T, expected[:, there] * UNITS.get(plot.unit, ("", 1))[1], rtol=1e-14)
    assert len(set(names(recorded, plot.path))) == len(columns)


@pytest.mark.parametrize("plot", PLOTS, ids=lambda plot: plot.path)
def test_plotted_values_equal_the_signal_table(eight, worn, signals, plot):
    columns = {series.column for series in plot.series}
    if not columns <= signals.keys():
        assert columns <= estimation_errors(eight.log.rows, 0).keys() | signals.keys()
        return
    if any(np.isfinite(signals[name]).any() for name in columns):
        check_plot(eight, signals, plot)
    else:
        check_plot(worn, {name: worn.log.column(name) for name in worn.log.rows.columns}, plot)


def test_plotted_steering_command_is_the_sum_of_its_plotted_components(eight):
    _, values = scalars(eight, "control/command")
    total, pd, network = values.T / DEG
    np.testing.assert_allclose(total, eight.log.column("steer_ref"), rtol=1e-14)
    np.testing.assert_allclose(pd, eight.log.column("tau_c"), rtol=1e-14)
    np.testing.assert_allclose(pd + network, total, atol=1e-12)
    assert names(eight, "control/command") == ["total", "PD tau_c", "network -tau_n"]


@pytest.mark.parametrize(
    ("path", "factor", "estimate", "truth", "variance"),
    [
        ("east", 100, "rear_x_hat", "rear_x", "p_xx"),
        ("north", 100, "rear_y_hat", "rear_y", "p_yy"),
        ("yaw", DEG, "yaw_hat", "yaw", "p_yaw"),
    ],
)
def test_plotted_estimates_lie_between_their_plotted_bounds(eight, path, factor, estimate, truth, variance):
    column = eight.log.column
    _, values = scalars(eight, f"estimator/{path}")
    upper, lower, error = values.T / factor
    np.testing.assert_allclose(error, column(estimate) - column(truth), atol=1e-12)
    np.testing.assert_allclose(upper, 3 * np.sqrt(column(variance)), rtol=1e-12)
    np.testing.assert_array_equal(lower, -upper)


def test_plotted_speed_error_is_the_error_of_the_estimate(eight):
    _, values = scalars(eight, "estimator/speed")
    np.testing.assert_allclose(values[:, 0], eight.log.column("speed_hat") - eight.log.column("speed"))


def test_plotted_yaw_errors_are_small_across_the_angle_wrap(short, tmp_path):
    yaw, yaw_hat = short.column("yaw"), short.column("yaw_hat")
    yaw[:], yaw_hat[:] = np.pi - 0.01, -np.pi + 0.02
    _, values = scalars(replay(short, tmp_path / "run.rrd"), "estimator/yaw")
    np.testing.assert_allclose(values[:, 2] / DEG, 0.03)


@pytest.fixture(scope="module")
def worn(tmp_path_factory):
    """Return a run with a fault and the estimator with a steering bias."""
    path = tmp_path_factory.mktemp("ailing") / "run.rrd"
    fault = {"kind": "gnss_loss", "start_s": 4, "end_s": 6}
    scenario = load_scenario("straight_line", {"duration_s": 8, "estimator.kind": "ekf_bias", "fault": [fault]})
    return Recorded(path, run(scenario, (Recording(path),)))


def test_plotted_network_parameters_equal_the_table_at_4_hz(eight, signals):
    for plot in network_plots(eight.log.rows.columns):
        check_plot(eight, signals, plot)
        look = (eight.static(f"/{plot.entity}", f"SeriesLines:{part}") for part in ("colors", "widths"))
        assert plot.every == (1 if plot.path == "network/q" else 5)
        assert plot.path == "network/q" or len(set(zip(*look, strict=True))) == len(plot.series), "no two look alike"


@pytest.mark.parametrize("bound", ["lower", "upper"])
def test_heat_maps_show_the_firing_strengths_and_their_numbers(eight, bound):
    times, buffers = eight.column(f"/network/firing_{bound}", "DepthImage:buffer")
    pictures = np.array([np.frombuffer(bytes(buffer[0]), dtype=np.float32) for buffer in buffers])
    expected = np.array([eight.log.column(f"w_{bound}_{rule}")[::5] for rule in RULES]).T
    np.testing.assert_array_equal(times, np.rint(eight.log.column("t")[::5] * 1e9))
    np.testing.assert_allclose(pictures, expected, rtol=1e-6)
    labels = eight.column(f"/network/firing_{bound}/values", "Points2D:labels")[1]
    np.testing.assert_allclose(np.array(labels, dtype=float), expected, atol=0.0051)
    shape = eight.static(f"/network/firing_{bound}", "DepthImage:format")[0]
    assert (shape["height"], shape["width"]) == (3, 3)


def test_parameters_of_a_network_of_another_size_are_plotted(tmp_path):
    sizes = {"controller.network.rules_1": 2, "controller.network.rules_2": 11}
    path = tmp_path / "run.rrd"
    run(load_scenario("straight_line", {"duration_s": 1, **sizes}), (Recording(path),))
    recorded = Recorded(path)
    shape = recorded.static("/network/firing_lower", "DepthImage:format")[0]
    assert (shape["height"], shape["width"]) == (2, 11)
    shown = names(recorded, "network/consequents")
    assert len(shown) == 18
    assert (shown[0], shown[-1]) == ("0,0", "1,10")
    assert len(names(recorded, "network/centres_2")) == 11


def test_every_plot_is_on_a_tab_of_the_recording(eight):
    recorded = {path.removeprefix("/plots/") for path in eight.entities() if path.startswith("/plots/")}
    tabs = *sum(TABS.values(), ()), *sum(COMPANIONS.values(), ())
    assert [path for path in recorded if not path.startswith((*DRIVE, *tabs))] == []
    assert f"/{FOLLOWED}" in eight.entities()


@pytest.mark.parametrize(
    ("keys", "present", "absent"),
    [
        ({"guidance.kind": "lqr"}, {"Control", "Tyres", "Estimator"}, {"Network"}),
        ({"guidance.kind": "stanley", "plant.kind": "bicycle"}, {"Control", "Estimator"}, {"Tyres", "Network"}),
        ({"controller.kind": "pd"}, {"Control", "Tyres"}, {"Network"}),
        ({}, {"Control", "Network"}, set()),
    ],
)
def test_recording_tab_exists_if_any_of_its_plots_exists(monkeypatch, tmp_path, keys, present, absent):
    layouts = []
    monkeypatch.setattr(recorder, "blueprint", lambda *a: layouts.append(blueprint(*a)) or layouts[-1])
    scenario = load_scenario("straight_line", {"duration_s": 1, **keys})
    run(scenario, (Recording(tmp_path / "run.rrd"),))
    tabs = {tab.name for tab in layouts[-1].root_container.contents}
    assert tabs >= {"Drive", "Info"} | present
    assert not tabs & absent


def test_plots_that_exceed_one_tab_are_distributed_over_several():
    plots = reported_plots([Column(f"own_{k}", "m", "a signal; null without a tool") for k in range(29)], ())
    layout = blueprint(Shown(plots), np.zeros((2, 3)), 0.0, 10.0)
    more = {tab.name: tab for tab in layout.root_container.contents if tab.name.startswith("More")}
    shown = {name: [view.name for row in tab.contents for view in row.contents] for name, tab in more.items()}
    assert list(shown) == ["More", "More 2", "More 3"]
    assert all(len(views) <= MOST_PLOTS for views in shown.values())
    assert [name for views in shown.values() for name in views] == ["A signal [m]"] * 29


def test_recording_text_names_the_guidance_law(tmp_path):
    scenario = load_scenario("straight_line", {"duration_s": 1, "guidance.kind": "lqr"})
    run(scenario, (Recording(tmp_path / "run.rrd"),))
    text = Recorded(tmp_path / "run.rrd").static("/info", "TextDocument:text")[0]
    assert "guidance **lqr**" in text
    assert "pd_t2fnn" not in text
    assert "guidance **kinematic with pd_t2fnn**" in running(load_scenario("straight_line"))


def test_plots_of_components_absent_from_the_run_are_not_drawn(tmp_path):
    path = tmp_path / "run.rrd"
    scenario = load_scenario("straight_line", {"duration_s": 1, "plant.kind": "bicycle", "controller.kind": "pd"})
    log, recorded = run(scenario, (Recording(path),)), Recorded(path)
    assert np.isnan(log.column("q")).all()
    plots = {entity.removeprefix("/plots/") for entity in recorded.entities() if entity.startswith("/plots/")}
    plots = {path for path in plots if not path.endswith("/mean")}
    reported = {path for path in plots if path.startswith("reported/")}
    assert {path.removeprefix("reported/") for path in reported} <= {column.name for column in log.rows.table}
    known = {name: log.column(name) for name in log.rows.columns} | estimation_errors(log.rows, 0)
    there = {name for name, values in known.items() if np.isfinite(values).any()}
    assert plots - reported == {plot.path for plot in PLOTS if there & {series.column for series in plot.series}}
    assert not plots & {"steering/pressure", "speed/torque", "tyres/load"}
    assert not any(entity.startswith("/network") for entity in recorded.entities())
    assert names(recorded, "control/command") == ["total", "PD tau_c"]
    assert all(np.isfinite(scalars(recorded, name)[1]).all() for name in plots)


def test_plot_units_correspond_to_the_units_of_the_log_columns(eight):
    units = {column.name: column.unit for column in eight.log.rows.table}
    for plot in (*PLOTS, *network_plots(eight.log.rows.columns), *COMPARED):
        for series in plot.series:
            if series.column in units:
                assert units[series.column] == UNITS.get(plot.unit, (plot.unit, 1))[0], series.column


@pytest.mark.parametrize(
    ("unit", "shown", "factor"),
    [("rad/s", "deg/s", DEG), ("m/s2", "m/s2", 1.0), ("N m/rad", "N m/rad", 1.0), ("deg", "deg", 1.0)],
)
def test_reported_column_is_plotted_in_the_unit_for_display(unit, shown, factor):
    (plot,) = reported_plots([Column("own", unit, "a signal of one's own")], ())
    assert (plot.entity, plot.names) == ("plots/reported/own", ["own"])
    assert plot.unit == shown
    assert plot.factor == pytest.approx(factor)


@pytest.mark.parametrize("broken", [np.nan, np.inf, 1e300])
def test_recording_of_a_diverged_run_is_readable(short, tmp_path, broken):
    """From tick 300 on all values are NaN."""
    for name in short.rows.columns:
        if name != "t":
            short.column(name)[300:] = broken
    short.rows.poses[300:] = broken
    recorded = replay(short, tmp_path / "run.rrd")
    assert len(recorded.column("/world/bodies/chassis", "Transform3D:translation")[0]) == 300
    times, values = scalars(recorded, "tracking/error")
    assert np.isfinite(values).all()
    write_comparison([("mujoco-a", short), ("mujoco-b", short)], tmp_path / "comparison.rrd")
    both = Recorded(tmp_path / "comparison.rrd")
    assert len(both.column("/world/mujoco-a/chassis", "Transform3D:translation")[0]) == 150


def test_plot_of_a_state_appears_only_if_the_log_has_its_column(short, tmp_path):
    assert "/states/link" not in replay(short, tmp_path / "without.rrd").entities()
    rows = short.rows
    rows.columns = (*rows.columns, "link_engaged")
    states = np.zeros(len(rows.values))
    states[100:], states[300:], states[350:] = 1, np.nan, 0
    rows._values.numbers = np.column_stack([rows.values, states])
    times, labels = replay(short, tmp_path / "with.rrd").column("/states/link", "StateChange:state")
    assert list(times // 50_000_000) == [0, 100, 300, 350]
    assert labels == [["not engaged"], ["engaged"], ["unknown"], ["not engaged"]]


def test_moving_mean_is_plotted_only_for_oscillating_signals(short, tmp_path):
    t = short.column("t")
    for wheel in WHEELS:
        short.column(f"load_{wheel}")[:] = 2000 + 1500 * np.sin(2 * np.pi * t)
        short.column(f"slip_ratio_{wheel}")[:] = 0.1 * np.sin(2 * np.pi * t / 20)
    recorded = replay(short, tmp_path / "run.rrd")
    _, means = scalars(recorded, "tyres/load/mean")
    np.testing.assert_allclose(means[5:-5], 2.0, atol=1e-6)
    assert names(recorded, "tyres/load/mean") == names(recorded, "tyres/load")
    opacity = {colour & 0xFF for colour in recorded.static("/plots/tyres/load", "SeriesLines:colors")}
    assert max(opacity) < 0x80, "the signal itself turns pale"
    assert "/plots/tyres/slip_ratio/mean" not in recorded.entities()
    _, values = scalars(recorded, "tyres/load")
    np.testing.assert_allclose(values[:, 0], short.column("load_fl") * 1e-3)


def test_plots_without_data_are_omitted_from_the_layout(short):
    signals = Signals(short.rows)
    signals.shown = [line.plot for line in signals.lines]
    stream = rr.RecordingStream("test")
    assert not {"estimator/faults", "estimator/quality"} & signals.finish(stream).keys()
    short.column("gnss_quality")[100:150] = 1
    found = signals.finish(stream).keys()
    assert "estimator/quality" in found
    assert "estimator/faults" not in found


def test_ticks_without_a_value_are_omitted_from_plots(short, tmp_path):
    short.column("position_nees")[150:320] = np.nan
    times, values = scalars(replay(short, tmp_path / "run.rrd"), "estimator/nees")
    there = np.r_[0:150, 320 : len(short.column("t"))]
    np.testing.assert_array_equal(times, there * 50_000_000)
    np.testing.assert_array_equal(values[:, 0], short.column("position_nees")[there])


def test_state_plot_shows_each_change_of_state(short, tmp_path):
    quality, saturated = short.column("gnss_quality"), short.column("steer_saturated")
    quality[:], saturated[:] = 2, 0
    quality[200:250], quality[250:400], saturated[199] = 0, 1, 1
    recorded = replay(short, tmp_path / "run.rrd")
    times, states = recorded.column("/states/gnss", "StateChange:state")
    assert list(times // 50_000_000) == [0, 200, 250, 400]
    assert states == [["fix"], ["none"], ["float"], ["fix"]]
    times, states = recorded.column("/states/steering", "StateChange:state")
    assert list(times // 50_000_000) == [0, 199, 200]
    assert states == [["free"], ["at its limit"], ["free"]]
