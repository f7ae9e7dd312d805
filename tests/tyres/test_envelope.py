"""Wheel on curved ground: height of a rigid circle, and contact force along the radius."""

from math import cos, sin, tan

import numpy as np
import pytest
from scipy.optimize import brentq

from agrobot_mj.terrain import Ground, Ridges, Rough
from agrobot_mj.terrain.grid import height_and_gradient, heights, plane
from agrobot_mj.tyres.patch import contact_plane

EAST = (0.0, 1.0, 0.0)  # Axle (to the left) of a wheel that rolls east


def stand(ground, radius, x, y=0.0, axle=EAST):
    """Return the height of the wheel centre at first contact, and the contact normal."""
    low, high = float(ground.heights.min()) + 0.5 * radius, float(ground.heights.max()) + 2 * radius
    z = brentq(lambda z: contact_plane(ground, radius, (x, y, z), axle)[1], low, high, xtol=1e-9)
    return z, contact_plane(ground, radius, (x, y, z), axle)[0]


def circle_on(ground, radius, x, y=0.0):
    """Return the height of the wheel centre at first contact by testing all points of the circle."""
    s = np.linspace(-radius, radius, 4001)
    return float((heights(ground, x + s, np.full(s.shape, y)) + np.sqrt(radius**2 - s**2)).max())


FURROWS = {
    "wide": Ridges(depth_m=0.1, spacing_m=2.0, half_size_m=5.0, node_m=0.02),
    "narrow": Ridges(depth_m=0.06, spacing_m=0.2, half_size_m=3.0, node_m=0.0125),
    "beds": Ridges(depth_m=0.1, spacing_m=0.75, profile="flat", half_size_m=5.0, node_m=0.02),
    "rough": Rough(iso_class="E", half_size_m=5.0, node_m=0.1),
}


@pytest.mark.parametrize("radius", [0.28, 0.42])
@pytest.mark.parametrize("name", FURROWS)
def test_wheel_height_on_uneven_ground_equals_a_rigid_circle_height(name, radius):
    ground = FURROWS[name].ground()
    places = np.linspace(-1.0, 1.0, 61)
    got = np.array([stand(ground, radius, x)[0] for x in places])
    want = np.array([circle_on(ground, radius, x) for x in places])
    assert np.abs(got - want).max() < 0.0015  # where two places share the load
    assert np.abs(got - want).mean() < 0.0003
    if name == "narrow":  # it spans two crests instead of touching the bottom
        assert np.ptp(got) < 1.1 * (radius - np.sqrt(radius**2 - 0.1**2)) < 0.03


@pytest.mark.parametrize("radius", [0.28, 0.42])
def test_wheel_contact_detects_all_peaks_of_rough_ground(radius):
    """Nodes at a spacing of a decimetre have independent heights."""
    rng = np.random.default_rng(5)
    ground = Ground(-3.0, -3.0, 0.1, rng.uniform(-0.01, 0.01, (61, 61)))
    s = np.linspace(-radius, radius, 4001)
    missed = []
    for x, y, yaw in rng.uniform(-1.5, 1.5, (150, 3)) * (1.0, 1.0, 2.1):
        z, _ = stand(ground, radius, x, y, (-sin(yaw), cos(yaw), 0.0))
        exact = heights(ground, x + s * cos(yaw), y + s * sin(yaw)) + np.sqrt(radius**2 - s**2)
        missed.append(exact.max() - z)
    assert np.abs(missed).max() < 0.004
    assert np.abs(missed).mean() < 0.001


UNEVEN = Ground(-2.5, -3.5, 0.1, np.random.default_rng(5).uniform(-0.01, 0.01, (71, 51)))


def steepest(ground, radius, centre, axle, h=1e-6):
    """Return the direction of wheel centre motion in which the penetration decreases fastest."""
    depths = [
        [contact_plane(ground, radius, tuple(centre + way * h * e), axle)[1] for way in (1, -1)] for e in np.eye(3)
    ]
    down = np.diff(depths)[:, 0]
    return down / np.linalg.norm(down)


@pytest.mark.parametrize("lean", [0.0, 0.2, -0.3])
def test_contact_force_direction_is_the_gradient_of_penetration(lean):
    """The gradient is computed by finite differences on a rectangular field of random heights, for any heading."""
    off, radius = [], 0.42
    s = np.linspace(-radius, radius, 4001)
    for x, y, yaw in np.random.default_rng(6).uniform(-1.5, 1.5, (20, 3)) * (1.0, 1.6, 2.1):
        axle = (-sin(yaw) * cos(lean), cos(yaw) * cos(lean), sin(lean))
        top = (heights(UNEVEN, x + s * cos(yaw), y + s * sin(yaw)) + np.sqrt(radius**2 - s**2)).max()
        centre = np.array([x, y, top - 0.01])
        n, depth = contact_plane(UNEVEN, radius, tuple(centre), axle)
        off.append(np.abs(n - steepest(UNEVEN, radius, centre, axle)).max())
        assert lean or depth == pytest.approx(0.01, abs=0.004)  # of an upright wheel: that of the circle
    assert np.median(off) < 0.005
    assert np.quantile(off, 0.8) < 0.03  # but where the place jumps to the next one


@pytest.mark.parametrize("radius", [0.28, 0.42])
def test_contact_normal_is_perpendicular_to_the_path_of_the_wheel_centre(radius):
    """Rolling without loss thus conserves energy."""
    ground = FURROWS["wide"].ground()
    for x in np.linspace(-0.9, 0.9, 37):
        z, n = stand(ground, radius, x)
        slope = (stand(ground, radius, x + 0.01)[0] - stand(ground, radius, x - 0.01)[0]) / 0.02
        assert -n[0] / n[2] == pytest.approx(slope, abs=0.03)
        assert n[1] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("yaw", [0.0, 0.6, 2.5])
@pytest.mark.parametrize("tilt", [0.0, 0.2])
def test_contact_on_a_plane_does_not_depend_on_the_number_of_cells(yaw, tilt):
    """Normal and penetration are equal for any heading and tilt of the wheel."""
    grade = tan(0.2), -0.1
    nodes = np.linspace(-3.0, 3.0, 41)
    many = Ground(-3.0, -3.0, 0.15, np.ascontiguousarray(grade[0] * nodes[None, :] + grade[1] * nodes[:, None]))
    axle = (-sin(yaw) * cos(tilt), cos(yaw) * cos(tilt), sin(tilt))
    for x, y, z in ((0.3, -0.4, 0.5), (0.11, 0.72, 0.4)):
        n, penetration = contact_plane(many, 0.42, (x, y, z), axle)
        m, depth = contact_plane(plane(*grade, 3.0), 0.42, (x, y, z), axle)
        assert n == pytest.approx(m, abs=1e-9)
        assert penetration == pytest.approx(depth, abs=1e-9)


def profile(h, nodes):
    """Return ground with the same profile to the east everywhere."""
    return Ground(nodes[0], nodes[0], nodes[1] - nodes[0], np.ascontiguousarray(np.tile(h, (nodes.size, 1))))


def test_contact_force_at_an_edge_points_away_from_the_edge():
    """Beyond the edge of a flank that falls by 45 deg, the wheel still rests on the edge, with a forward force."""
    nodes = np.arange(-100, 101) * 0.02
    brink = profile(-np.clip(nodes, 0.0, 0.5), nodes)
    for x in (0.05, 0.15, 0.25):
        z, n = stand(brink, 0.42, x)
        assert z == pytest.approx(np.sqrt(0.42**2 - x**2), abs=0.004)
        assert n[0] == pytest.approx(x / 0.42, abs=0.06)


def test_load_on_a_bridged_ditch_is_divided_between_its_edges():
    """The force on the wheel is vertical above the middle. Off the middle, it points away from the nearer edge."""
    nodes = np.arange(-100, 101) * 0.02
    ditch = profile(np.clip(np.abs(nodes) - 0.2, -0.2, 0.0), nodes)
    assert stand(ditch, 0.42, 0.0)[1] == pytest.approx((0.0, 0.0, 1.0), abs=0.01)
    assert stand(ditch, 0.42, 0.03)[1][0] < -0.2 < 0.2 < stand(ditch, 0.42, -0.03)[1][0]


@pytest.mark.parametrize("x", [-0.013, -0.01, 0.008, 0.01])
def test_force_direction_between_two_contacts_is_the_penetration_gradient(x):
    """The furrow of 8 mm is so shallow that its bottom carries a part of the load."""
    nodes = np.arange(-100, 101) * 0.02
    furrow = profile(-0.008 * np.cos(np.pi / 0.2 * np.clip(nodes, -0.1, 0.1)), nodes)
    centre = np.array([x, 0.01, 0.408])
    n, _ = contact_plane(furrow, 0.42, tuple(centre), EAST)
    assert n == pytest.approx(steepest(furrow, 0.42, centre, EAST), abs=5e-4)


def test_penetration_of_a_wheel_lying_flat_is_evaluated_at_its_centre():
    ground = FURROWS["wide"].ground()
    for x, z in ((0.3, 0.2), (-0.7, -0.05)):
        n, depth = contact_plane(ground, 0.42, (x, 0.4, z), (0.0, 0.0, 1.0))
        assert n == (0.0, 0.0, 1.0)
        assert depth == pytest.approx(height_and_gradient(ground, x, 0.4)[0] - z)


NODES = np.arange(-60, 61) * 0.1
EDGES = {
    "step": profile(np.where(NODES > 0.02, 0.1, 0.0), NODES),
    "sawteeth": profile(0.03 * (np.arange(121) % 5) / 4.0, NODES),
    "furrows": Ridges(half_size_m=6.0).ground(),
    "rough": Rough(iso_class="E", half_size_m=6.0, node_m=0.1).ground(),
    "nodes": Ground(-6.0, -6.0, 0.1, np.random.default_rng(5).uniform(-0.01, 0.01, (121, 121))),
}


def circle_height(ground, radius, x, y, axle):
    """Return the height of the centre at which a wheel just touches the ground [m]."""
    base = height_and_gradient(ground, x, y)[0]
    return brentq(lambda z: contact_plane(ground, radius, (x, y, z), axle)[1], base + 0.7 * radius, base + 2 * radius)


def carried(ground, radius, x, y, axle, load, stiffness):
    """Return the height at which a wheel carries a load [m], and the horizontal force at this height [N]."""

    def excess(z):
        n, p = contact_plane(ground, radius, (x, y, z), axle)
        return stiffness * max(p, 0.0) * n[2] - load

    top = circle_height(ground, radius, x, y, axle)
    z = brentq(excess, top - 0.03, top + 1e-3, xtol=1e-10)
    n, p = contact_plane(ground, radius, (x, y, z), axle)
    return z, np.array((stiffness * p * n[0], stiffness * p * n[1]))


def thrust(ground, radius, way, axle, load=1000.0, stiffness=1.4e5):
    """Return the work of a frictionless wheel dragged along `way` (n, 2) [m], divided by load times distance [-]."""
    forces = np.array([carried(ground, radius, x, y, axle, load, stiffness)[1] for x, y in way])
    steps = np.diff(way, axis=0)
    work = (0.5 * (forces[1:] + forces[:-1]) * steps).sum()
    return work / (load * np.hypot(*steps.T).sum())


@pytest.mark.parametrize("lean", [0.0, 0.1])
@pytest.mark.parametrize("radius", [0.28, 0.42])
@pytest.mark.parametrize("name", EDGES)
def test_closed_path_of_a_wheel_on_uneven_ground_gains_no_energy(name, radius, lean):
    """Accuracy is 0.05 % of load times distance on any ground, half of it due to the discretised loop."""
    t = np.linspace(0.0, 2 * np.pi, 1501)
    loop = np.column_stack([1.3 * np.cos(t) + 0.3, 0.9 * np.sin(t) + 0.2])
    axle = (-sin(0.4) * cos(lean), cos(0.4) * cos(lean), sin(lean))
    assert abs(thrust(EDGES[name], radius, loop, axle)) < 5e-4


def test_sawtooth_ground_gives_no_net_thrust():
    way = np.column_stack([np.linspace(-1.0, 1.0, 2001), np.full(2001, 0.03)])  # four whole teeth
    assert abs(thrust(EDGES["sawteeth"], 0.42, way, EAST)) < 1e-4


def test_wheel_on_top_of_a_step_is_at_the_height_of_the_step():
    for x in (0.1, 0.2, 0.5):
        z, force = carried(EDGES["step"], 0.42, x, 0.0, EAST, 1000.0, 1.4e5)
        assert z == pytest.approx(0.1 + 0.42 - 1000.0 / 1.4e5, abs=1e-7)
        assert np.abs(force).max() < 1e-6
