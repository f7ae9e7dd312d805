import numpy as np
import pytest
from recorded import Recorded

from agrobot_mj import load_scenario, run
from agrobot_mj.metrics.crosstrack import cross_track
from agrobot_mj.recording import info, write_comparison


@pytest.fixture(scope="module")
def compared(tmp_path_factory):
    """Return a comparison of two plants, one of which ends early, with a network."""
    changes = {
        "bicycle-pd": {"plant.kind": "bicycle", "controller.kind": "pd", "duration_s": 4},
        "mujoco-pd_t2fnn": {"controller.kind": "pd_t2fnn", "duration_s": 6},
    }
    logs = {name: run(load_scenario("circle", change)) for name, change in changes.items()}
    path = tmp_path_factory.mktemp("compared") / "comparison.rrd"
    write_comparison(list(logs.items()), path)
    return Recorded(path), logs


def test_every_compared_run_has_its_curves_in_the_plots(compared):
    recorded, logs = compared
    factor = 180 / np.pi
    for name, log in logs.items():
        for path, expected in (
            ("cross_track", cross_track(log.scenario.path, log.column("t"), log.column("x"), log.column("y"))),
            ("command", log.column("steer_ref") * factor),
            ("yaw_rate", log.column("e_yaw_rate") * factor),
            ("speed", log.column("speed")),
        ):
            times, values = recorded.column(f"/plots/{path}/{name}", "Scalars:scalars")
            np.testing.assert_array_equal(times, np.rint(log.column("t") * 1e9))
            np.testing.assert_allclose(np.ravel(values), expected, rtol=1e-14)
            assert recorded.static(f"/plots/{path}/{name}", "SeriesLines:names") == [name]


def test_network_contribution_is_recorded_only_with_a_network(compared):
    recorded, logs = compared
    assert "/plots/network/bicycle-pd" not in recorded.entities()
    _, values = recorded.column("/plots/network/mujoco-pd_t2fnn", "Scalars:scalars")
    np.testing.assert_allclose(np.ravel(values), -logs["mujoco-pd_t2fnn"].column("tau_n") * 180 / np.pi, rtol=1e-14)


def test_tractors_move_as_logged_and_have_separate_colours(compared):
    recorded, logs = compared
    for name, log in logs.items():
        times, places = recorded.column(f"/world/{name}/chassis", "Transform3D:translation")
        np.testing.assert_array_equal(times, np.rint(log.column("t")[::2] * 1e9))
        np.testing.assert_allclose(np.array(places)[:, 0], log.poses[::2, 0, :3], atol=1e-5)
    paint = [recorded.static(f"/world/{name}/chassis/boxes", "Boxes3D:colors") for name in logs]
    colours = [recorded.static(f"/plots/cross_track/{name}", "SeriesLines:colors")[0] >> 8 for name in logs]
    assert colours[0] in {colour >> 8 for colour in paint[0]}
    assert colours[1] in {colour >> 8 for colour in paint[1]}
    assert colours[0] not in {colour >> 8 for colour in paint[1]}
    opacities = [{colour & 0xFF for colour in shown} for shown in paint]
    assert max(opacities[0]) < 0x80, "all but the last are translucent"
    assert opacities[1] == {0xFF}


def test_tracks_of_compared_runs_are_drawn_at_different_heights(compared):
    recorded, logs = compared
    lifts, radii = [], []
    for name in logs:
        _, pieces = recorded.column(f"/world/tracks/{name}", "LineStrips3D:strips")
        heights = {round(point[2], 4) for (piece,) in pieces for point in piece}
        lifts += heights
        radii += recorded.static(f"/world/tracks/{name}", "LineStrips3D:radii")
    assert len(lifts) == len(logs)
    assert np.diff(lifts) > 0.05
    assert np.diff(np.abs(radii)) < 0, "a lower track shows on both sides of an upper one"


def test_difference_of_every_later_run_from_the_first_is_plotted(compared):
    recorded, logs = compared
    first, other = (np.ravel(recorded.column(f"/plots/cross_track/{name}", "Scalars:scalars")[1]) for name in logs)
    _, values = recorded.column("/plots/difference/mujoco-pd_t2fnn", "Scalars:scalars")
    np.testing.assert_allclose(np.ravel(values), other[: len(first)] - first)
    assert "/plots/difference/bicycle-pd" not in recorded.entities()


def test_each_tractor_is_labelled_with_the_name_of_its_run(compared):
    recorded, logs = compared
    heights = []
    for name, log in logs.items():
        entity = f"/world/names/{name}"
        assert recorded.static(entity, "Points3D:labels") == [name]
        times, places = recorded.column(entity, "Points3D:positions")
        np.testing.assert_array_equal(times, np.rint(log.column("t")[::2] * 1e9))
        above = np.array(places)[:, 0] - log.poses[::2, 0, :3]
        np.testing.assert_allclose(above[:, :2], 0.0, atol=1e-5)
        heights.append(above[0, 2])
    assert heights[0] > 1.0
    assert heights[1] - heights[0] > 0.15, "names of tractors at one place are apart"


def test_ground_is_drawn_once_and_text_explains_the_run_colours(compared):
    recorded, logs = compared
    assert "/world/ground" in recorded.entities()
    info = recorded.static("/info", "TextDocument:text")[0]
    assert "| bicycle-pd | #e69f00 orange | completed |" in info
    for log in logs.values():
        assert f"{log.metrics['xte_rms']:.4g}" in info


def test_comparison_text_lists_the_metrics_of_each_run(compared):
    """A law without a yaw controller has no yaw-rate error."""
    _, logs = compared
    log = run(load_scenario("circle", {"plant.kind": "bicycle", "guidance.kind": "stanley", "duration_s": 2}))
    assert "yaw_rate_error_rms" not in info.comparison_text(log.scenario, [("stanley", 0xFF, log)])
    both = info.comparison_text(log.scenario, [("stanley", 0xFF, log), ("pd", 0xFF, logs["bicycle-pd"])])
    assert "yaw_rate_error_rms" in both
