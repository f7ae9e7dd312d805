import numpy as np
import pytest
from recorded import replay
from rerun.blueprint import TextDocumentView

from agrobot_mj import load_scenario
from agrobot_mj.paths import sample
from agrobot_mj.plants.scene import Geom, Mesh, Scene
from agrobot_mj.recording.blueprint import Shown, blueprint, tile_views
from agrobot_mj.recording.world.names import ASIDE_M, size_in_view
from agrobot_mj.recording.world.scene import camera_target, reference_line, shapes
from agrobot_mj.terrain import Ground, height_and_gradient
from agrobot_mj.terrain.grid import heights

TILT = (np.cos(0.3), 0.0, np.sin(0.3), 0.0)  # 0.6 rad about y


def points(values):
    return np.array([point for piece in values for point in piece])


def test_recorded_body_poses_equal_the_log(eight):
    for i, body in enumerate(eight.log.scene.bodies):
        times, places = eight.column(f"/world/bodies/{body}", "Transform3D:translation")
        _, turns = eight.column(f"/world/bodies/{body}", "Transform3D:quaternion")
        pose = eight.log.poses[:, i]
        np.testing.assert_array_equal(times, np.rint(eight.log.column("t") * 1e9))
        np.testing.assert_array_equal(points(places), pose[:, :3].astype(np.float32))
        np.testing.assert_array_equal(points(turns), pose[:, [4, 5, 6, 3]].astype(np.float32))


def test_every_mujoco_geom_is_drawn(eight):
    sizes = {
        **{"boxes": "Boxes3D:half_sizes", "cylinders": "Cylinders3D:radii"},
        **{"capsules": "Capsules3D:radii", "ellipsoids": "Ellipsoids3D:half_sizes"},
    }
    for body in eight.log.scene.bodies:
        drawn = [
            len(eight.static(f"/world/bodies/{body}/{shape}", component))
            for shape, component in sizes.items()
            if f"/world/bodies/{body}/{shape}" in eight.entities()
        ]
        assert sum(drawn) == len([geom for geom in eight.log.scene.geoms if geom.body == body])


def test_drawn_shapes_have_the_sizes_of_the_mujoco_geoms():
    colour, place = (0.2, 0.4, 0.6, 1.0), (1.0, 2.0, 3.0)
    geoms = [
        Geom(kind, "b", kind, (0.1, 0.2, 0.3), place, TILT, colour)
        for kind in ("box", "cylinder", "capsule", "sphere", "ellipsoid")
    ]
    drawn = shapes(geoms)
    assert drawn["boxes"].half_sizes.as_arrow_array().to_pylist() == [pytest.approx([0.1, 0.2, 0.3])]
    assert drawn["boxes"].quaternions.as_arrow_array().to_pylist() == [pytest.approx([*TILT[1:], TILT[0]])]
    assert drawn["boxes"].colors.as_arrow_array().to_pylist() == [0x336699FF]
    assert drawn["cylinders"].lengths.as_arrow_array().to_pylist() == pytest.approx([0.4])
    assert drawn["capsules"].lengths.as_arrow_array().to_pylist() == pytest.approx([0.4])
    assert drawn["ellipsoids"].half_sizes.as_arrow_array().to_pylist() == [
        pytest.approx([0.1, 0.1, 0.1]),
        pytest.approx([0.1, 0.2, 0.3]),
    ]
    start = drawn["capsules"].translations.as_arrow_array().to_pylist()[0]
    along = np.array([np.sin(0.6), 0.0, np.cos(0.6)])
    np.testing.assert_allclose(np.add(start, 0.2 * along), place, atol=1e-6)


def test_body_mesh_is_drawn_at_its_pose_and_followed_by_the_camera():
    corners = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    surface = Mesh(corners, np.array([[0, 1, 2]]))
    quarter = (np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5))
    shed = Geom("shed", "chassis", "mesh", (1.0, 1.0, 0.1), (1.0, 2.0, 3.0), quarter, (1.0, 0.0, 0.0, 1.0), surface)
    drawn = shapes([shed])["meshes/0"]
    placed = drawn.vertex_positions.as_arrow_array().to_pylist()
    np.testing.assert_allclose(placed, [[1, 2, 3], [1, 3, 3], [0, 2, 3]], atol=1e-6)
    np.testing.assert_allclose(drawn.vertex_normals.as_arrow_array().to_pylist(), 3 * [[0, 0, 1]], atol=1e-6)
    assert camera_target(Scene(("chassis",), (shed,))) == "chassis/meshes/0"
    box = shed._replace(kind="box", mesh=None)
    assert camera_target(Scene(("chassis",), (shed, box))) == "chassis/boxes"


@pytest.mark.parametrize(("track", "x", "y"), [("true", "x", "y"), ("estimated", "x_hat", "y_hat")])
def test_drawn_track_segments_are_connected_up_to_the_current_tick(eight, track, x, y):
    times, pieces = eight.column(f"/world/tracks/{track}", "LineStrips3D:strips")
    path = np.column_stack([eight.log.column(x), eight.log.column(y)]).astype(np.float32)
    ticks, begins = times // 50_000_000, 0
    for tick, (piece,) in zip(ticks, pieces, strict=True):
        np.testing.assert_array_equal(np.array(piece)[:, :2], path[begins : tick + 1])
        begins = tick
    assert np.diff(ticks).max() == 5
    assert ticks[-1] == len(path) - 1


def test_gnss_fixes_are_drawn_where_available(short, tmp_path):
    x, y, quality = (short.column(name) for name in ("gnss_x", "gnss_y", "gnss_quality"))
    x[30:57], quality[30:57], quality[57:60] = np.nan, 0, 1
    recorded = replay(short, tmp_path / "run.rrd")
    times, fixes = recorded.column("/world/tracks/gnss", "Points3D:positions")
    _, colours = recorded.column("/world/tracks/gnss", "Points3D:colors")
    there = np.isfinite(x)
    found = np.array([fix for piece in fixes for fix in piece])
    np.testing.assert_array_equal(found[:, :2], np.column_stack([x, y])[there].astype(np.float32))
    assert [len(piece) for piece in fixes][5:13] == [5, 0, 0, 0, 0, 0, 3, 5]
    assert times[5] == 29 * 50_000_000
    assert [colour for piece in colours for colour in piece][29:34] == [0x009E73FF] + 3 * [0xE69F00FF] + [0x009E73FF]


def test_drawn_reference_covers_the_whole_path(eight):
    scenario = eight.log.scenario
    (line,) = eight.static("/world/path", "LineStrips3D:strips")
    ends = sample(scenario.path, [0.0, 25.4])
    np.testing.assert_allclose(np.array(line)[[0, -1], :2], ends, atol=1e-5)


def test_drawn_ground_heights_equal_those_used_for_wheel_contact():
    rng = np.random.default_rng(3)
    ground = Ground(-2.0, -3.0, 0.5, rng.normal(size=(13, 9)))
    x, y = rng.uniform(-4, 4, size=(2, 500))
    expected = [height_and_gradient(ground, *place)[0] for place in zip(x, y, strict=True)]
    np.testing.assert_allclose(heights(ground, x, y), expected, atol=1e-12)


def test_layout_without_plots_is_valid():
    blueprint(Shown([]), np.zeros((1, 3)), 0.0, 1.0)


def test_plot_layout_is_tiled_without_empty_cells():
    for count in range(1, 14):
        views = [TextDocumentView(origin=f"{i}") for i in range(count)]
        rows = tile_views(views, "Tab").contents
        sizes = [len(row.contents) for row in rows]
        assert sum(sizes) == count
        assert max(sizes) <= 3
        assert max(sizes) - min(sizes) <= 1


def test_drawn_reference_of_a_long_run_is_sampled_finely():
    scenario = load_scenario("one_hectare")
    line = reference_line(scenario, scenario.terrain.ground())
    assert np.hypot(*np.diff(line[:, :2], axis=0).T).max() <= 0.25 + 1e-9


def test_true_estimated_and_reference_tracks_are_labelled(eight):
    """The labels of both tracks are on opposite sides of the tracks, so that labels do not overlap."""
    assert eight.static("/world/names", "Points3D:labels") == ["reference", "true", "estimated"]
    times, places = eight.column("/world/names", "Points3D:positions")
    np.testing.assert_array_equal(times, np.rint(eight.log.column("t")[::2] * 1e9))
    reference, true, estimated = np.array(places)[100]
    x, y, yaw = (eight.log.column(name) for name in ("x", "y", "yaw"))
    left = [
        (place[1] - y[200]) * np.cos(yaw[200]) - (place[0] - x[200]) * np.sin(yaw[200]) for place in (true, estimated)
    ]
    assert left == pytest.approx([ASIDE_M, -ASIDE_M], abs=0.2)
    assert np.hypot(x - true[0], y - true[1]).min() == pytest.approx(ASIDE_M, abs=0.05), "next to its track"
    assert np.hypot(x[200] - reference[0], y[200] - reference[1]) > 1.5
    assert 0.4 < np.hypot(*(true - estimated)[:2]) < 1.5
    last = np.array(places)[-1, 0]
    assert np.hypot(x[-1] - last[0], y[-1] - last[1]) > 1.5, "not on the tractor at the end of the path"


def test_camera_moves_back_for_a_trailer_but_not_for_the_front_axle():
    chassis, front, trailer = [7.0, 3.0], [8.4, 3.0], [4.5, 3.0]
    assert size_in_view(1.0, np.array([chassis, front])) == 1.0
    assert size_in_view(1.0, np.array([chassis, front, trailer])) == pytest.approx(1.75)
