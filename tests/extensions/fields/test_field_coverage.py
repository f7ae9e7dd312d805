"""Coverage compared with closed forms: parallel passes with known offsets, sections with delays, and circles."""

from math import pi

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from agrobot_mj.extensions.fields.boom import Boom, ImplementMotion, swept_area, switching_times, worked_area
from agrobot_mj.extensions.fields.coverage import areas, coverage, excursion, gaps, side_of
from agrobot_mj.extensions.fields.report import _areas

LENGTH, WIDTH, SPEED = 100.0, 6.0, 2.0
EMPTY = shapely.Polygon()


def straight(y, first=0.0, last=LENGTH):
    """Return the motion along a pass to the east at 2 m/s, with a point every 0.1 m."""
    x = np.linspace(first, last, round((last - first) / 0.1) + 1)
    zero = np.zeros_like(x)
    return ImplementMotion(x / SPEED, x, zero + y, zero, x)


def strip(y, width=WIDTH):
    """Return the ground covered by a complete pass."""
    motion = straight(y)
    return swept_area(motion.between(0.0, LENGTH / SPEED), width / 2, -width / 2)


@given(st.lists(st.floats(-0.4, 0.4), min_size=2, max_size=6))
@settings(max_examples=20, deadline=None)
def test_missed_and_overlapped_areas_follow_from_the_pass_offsets(offsets):
    middles = [(k + 0.5) * WIDTH + each for k, each in enumerate(offsets)]
    field = shapely.box(0, middles[0] - WIDTH / 2, LENGTH, middles[-1] + WIDTH / 2)
    found = areas(coverage(field, EMPTY, [strip(y) for y in middles]))["field"]
    excess = np.diff(middles) - WIDTH
    assert found["missed_m2"] == pytest.approx(LENGTH * excess[excess > 0].sum(), rel=1e-3, abs=1e-6)
    assert found["overlapped_m2"] == pytest.approx(-LENGTH * excess[excess < 0].sum(), rel=1e-3, abs=1e-6)
    assert found["covered_m2"] == pytest.approx(len(middles) * WIDTH * LENGTH, rel=1e-3)


@given(st.lists(st.tuples(st.floats(0, 90), st.floats(0, 40), st.floats(0.5, 9)), min_size=1, max_size=8))
@settings(max_examples=30, deadline=None)
def test_covered_overlapped_and_missed_areas_add_up_to_the_field(places):
    field, body = shapely.box(0, 0, 100, 50).difference(shapely.box(30, 20, 40, 30)), shapely.box(10, 10, 90, 40)
    passes = [shapely.Point(x, y).buffer(radius) for x, y, radius in places]
    for part in areas(coverage(field, body, passes)).values():
        assert part["covered_m2"] - part["overlapped_m2"] + part["missed_m2"] == pytest.approx(
            part["area_m2"], abs=1e-6
        )


def test_implement_moved_along_a_circle_covers_the_area_of_a_ring():
    angle = np.linspace(0.0, 1.5 * pi, 400)
    radius = 12.0
    motion = ImplementMotion(angle, radius * np.cos(angle), radius * np.sin(angle), angle + pi / 2, radius * angle)
    ring = swept_area(motion.between(0.0, 1.5 * pi), 3.0, -3.0)
    assert ring.area == pytest.approx(0.75 * pi * (15.0**2 - 9.0**2), rel=1e-3)


def test_area_covered_in_two_laps_of_a_circle_counts_once():
    angle = np.linspace(0.0, 2.5 * pi, 800)
    motion = ImplementMotion(angle, 12 * np.cos(angle), 12 * np.sin(angle), angle + pi / 2, 12 * angle)
    ring = swept_area(motion.between(0.0, 2.5 * pi), 3.0, -3.0)
    assert ring.area == pytest.approx(pi * (15.0**2 - 9.0**2), rel=1e-3)


def test_area_swept_backwards_by_an_implement_end_in_a_turn_is_covered():
    angle = np.linspace(0.0, pi, 400)
    motion = ImplementMotion(angle, np.cos(angle), np.sin(angle), angle + pi / 2, angle)
    half = swept_area(motion.between(0.0, pi), 3.0, -3.0)
    assert half.area == pytest.approx(pi * 4**2 / 2 + pi * 2**2 / 2, rel=5e-3)


@pytest.mark.parametrize(
    ("on_delay", "off_delay", "on_ahead", "off_ahead", "length"),
    [(0, 0, 0, 0, 50.0), (0.4, 0, 0, 0, 49.2), (0, 0.4, 0, 0, 50.8), (0.4, 0.4, 0.4, 0.4, 50.0), (0, 0, 0.5, 0, 51.0)],
)
def test_section_switching_delays_shift_the_ends_of_the_covered_area(on_delay, off_delay, on_ahead, off_ahead, length):
    boom = Boom(WIDTH, 1, on_delay, off_delay, on_ahead, off_ahead)
    motion = straight(0.0)
    times = switching_times(motion, (20.0, 70.0), slice(0, None), boom)
    assert worked_area(motion, [times], boom).area == pytest.approx(length * WIDTH, rel=1e-3)


def test_each_implement_section_covers_its_own_part_of_the_swath():
    boom, motion = Boom(WIDTH, 3, 0.25, 0.1), straight(0.0)
    spans = [(10.0, 60.0), (20.0, 60.0), (20.0, 80.0)]
    times = [switching_times(motion, span, slice(0, None), boom) for span in spans]
    ground = worked_area(motion, times, boom)
    assert ground.area == pytest.approx(2.0 * sum(b - a - 0.15 * SPEED for a, b in spans), rel=1e-3)
    assert shapely.box(10.5, 1.0, 60.0, 3.0).within(ground.buffer(1e-6))


def test_section_without_a_working_interval_covers_no_area():
    assert switching_times(straight(0.0), (30.0, 30.0), slice(0, None), Boom(WIDTH)) is None


def test_track_noise_does_not_change_the_covered_area():
    rng = np.random.default_rng(1)
    motion = straight(0.0)
    noisy = motion._replace(y=motion.y + np.cumsum(rng.normal(0, 0.002, motion.x.size)))
    assert swept_area(noisy.between(0.0, 50.0), 3.0, -3.0).area == pytest.approx(LENGTH * WIDTH, rel=1e-3)


def test_missed_areas_are_reported_with_their_location_in_the_field():
    field, body = shapely.box(0, 0, 100, 50), shapely.box(10, 10, 90, 40)
    worked_ground = field.difference(shapely.box(0, 20, 5, 30)).difference(shapely.box(50, 20, 52, 22))
    found = gaps(coverage(field, body, [worked_ground]))
    assert [(gap["place"], round(gap["area_m2"])) for gap in found] == [("west headland", 50), ("body", 4)]


@pytest.mark.parametrize("notch", [0.0, 30.0])
def test_missed_strip_along_the_boundary_counts_on_each_side(notch):
    field = shapely.box(0, 0, 100, 50).difference(shapely.box(60, 50 - notch, 100, 50))
    worked_ground = field.buffer(-1.0, join_style="mitre")
    found = {each["place"]: each["area_m2"] for each in gaps(coverage(field, EMPTY, [worked_ground]))}
    assert sum(found.values()) == pytest.approx(field.area - worked_ground.area)
    if not notch:
        sides = {"east": 50.0, "west": 50.0, "north": 98.0, "south": 98.0}  # divided by the diagonals
        assert found == pytest.approx({f"{side} headland": area for side, area in sides.items()})


def test_compass_direction_of_the_nearest_field_side_is_named():
    field = shapely.box(0, 0, 100, 20)
    assert [side_of(*at, field) for at in ((49, 1), (-45, 2), (3, 9), (-2, -8))] == ["east", "west", "north", "south"]


def test_excursion_gives_distance_area_and_side_beyond_the_boundary():
    field = shapely.box(0, 0, 100, 50)
    boxes = np.array([shapely.box(-1.5, 20, 1, 22), shapely.box(40, 20, 42, 22)])
    found = excursion({"tractor": boxes, "implement": boxes[1:]}, field)
    assert -1.5 < found["tractor"]["x"] < 0.0
    assert (found["tractor"]["largest_m"], found["tractor"]["area_m2"], found["tractor"]["side"]) == (1.5, 3.0, "west")
    assert found["implement"]["largest_m"] == 0.0


def test_pole_below_the_tractor_is_as_deep_as_the_tractor_covers_it():
    field = shapely.box(0, 0, 100, 50).difference(shapely.box(41.0, 20.8, 41.2, 21.0))
    found = excursion({"tractor": np.array([shapely.box(40, 20, 43, 22)])}, field)["tractor"]
    assert (found["largest_m"], found["area_m2"]) == pytest.approx((1.0, 0.04))
    assert (found["x"], found["y"]) == pytest.approx((41.1, 20.9), abs=0.11)


@pytest.mark.parametrize("offset", [0.0, 0.123456, -0.0987654])
def test_printed_shares_of_the_report_add_up_to_the_field(offset):
    passes = [strip(k * WIDTH + (k == 2) * offset) for k in range(5)]
    part = areas(coverage(shapely.box(0, 0, LENGTH, 4 * WIDTH), EMPTY, passes))["field"]
    ((name, _, worked, missed, overlapped, covered),) = _areas({"areas": {"field": part}})
    assert name == "field"
    assert worked + missed == pytest.approx(100.0, abs=1e-9)
    assert covered - overlapped + missed == pytest.approx(100.0, abs=1e-9)
    assert (worked, covered) == pytest.approx((part["worked_percent"], part["covered_percent"]), abs=0.011)
