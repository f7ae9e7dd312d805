"""GNSS outages at given positions: below trees, the receiver has a float solution or none; outside, it recovers."""

from math import sqrt

import numpy as np
import pytest
from pydantic import ValidationError

from agrobot_mj import load_scenario, run
from agrobot_mj.core.geometry import in_polygon
from agrobot_mj.core.signals import NOMINAL, Quality, Truth
from agrobot_mj.sensors import Canopy, Gnss

DT = 0.05
STRIP = ((10.0, -3.0), (20.0, -3.0), (20.0, 3.0), (10.0, 3.0))


def truth(x, y=0.0, t=0.0):
    return Truth(
        *(t, x, y, 0.5, 0.3, 0.0, 0.0, 1.2, 0.0, 0.0, 0.1, 0.5, x, y),
        antenna=(x, y, 2.0),
        antenna_velocity=(1.1, 0.4, 0.0),
        steer_samples=np.full(25, 0.1),
        pedal_samples=np.full(25, 0.5),
    )


def qualities(canopy, xs, seed=1, conditions=NOMINAL):
    gnss, found = Gnss(canopy=(canopy,)), []
    state = gnss.init(seed)
    for x in xs:
        state, reading = gnss.measure(state, truth(x), conditions, DT)
        found.append(reading.quality)
        assert (reading.fix is None) == (reading.quality == Quality.NONE)
    return np.array(found)


def test_fix_quality_below_a_canopy_is_float_and_recovers_with_delay():
    xs = np.arange(0.0, 40.0, 0.06)
    found = qualities(Canopy(points=STRIP, lapse_share=0.0, refix_s=4.0), xs)
    below = (xs > 10.0) & (xs < 20.0)
    late = (xs >= 20.0) & (np.arange(len(xs)) < np.flatnonzero(below)[-1] + round(4.0 / DT))
    assert (found[below | late] == Quality.FLOAT).all()
    assert (found[~(below | late)] == Quality.FIX).all()


def test_receiver_under_fully_obstructed_sky_gives_no_solution():
    found = qualities(Canopy(points=STRIP, sky="none", refix_s=0.0), [5.0, 15.0, 25.0])
    assert found.tolist() == [Quality.FIX, Quality.NONE, Quality.FIX]


def test_gnss_losses_have_the_configured_fraction_and_mean_duration():
    """A two-state Markov chain gives the fraction, and the mean of its geometric dwell times."""
    n, canopy = 60_000, Canopy(points=STRIP, lapse_share=0.3, lapse_s=0.5)
    none = qualities(canopy, np.full(n, 15.0)) == Quality.NONE
    begins = np.flatnonzero(np.diff(none.astype(int)) == 1)
    # correlation over lapse_s (1 - share) makes the effective number of samples that much smaller
    effective = n * DT / (2 * 0.5 * 0.7)
    assert none.mean() == pytest.approx(0.3, abs=5 * sqrt(0.3 * 0.7 / effective))
    assert none.sum() * DT / len(begins) == pytest.approx(0.5, rel=5 / sqrt(len(begins)))


def test_worse_fix_quality_of_a_gnss_fault_takes_precedence_over_canopy():
    lost = NOMINAL._replace(gnss_quality=Quality.NONE)
    assert qualities(Canopy(points=STRIP, lapse_share=0.0), [15.0], conditions=lost)[0] == Quality.NONE


def test_canopy_does_not_change_the_noise_of_fixes_outside_the_canopy():
    """Outside the canopy, the fixes equal the fixes of a receiver without a canopy."""
    fixes = []
    for canopy in ((Canopy(points=STRIP),), ()):
        gnss = Gnss(canopy=canopy)
        state = gnss.init(3)
        for x in (*[5.0] * 10, *[15.0 if canopy else 5.0] * 20, *[5.0] * 300):
            state, reading = gnss.measure(state, truth(x), NOMINAL, DT)
        fixes.append(reading)
    assert fixes[0] == fixes[1]


@pytest.mark.parametrize("points", [((0.0, 0.0), (1.0, 0.0), (0.0, 0.0)), ((0.0, 0.0), (1.0, 1.0), (2.0, 2.0))])
def test_canopy_polygon_without_area_is_rejected(points):
    with pytest.raises(ValidationError, match="points: "):
        Canopy(points=points)


@pytest.mark.parametrize("points", [STRIP, ((0, 0), (4, 0), (4, 4), (2, 1), (0, 4)), ((0, 0), (5, 1), (1, 5))])
def test_point_in_polygon_test_agrees_with_the_winding_number(points):
    """The winding number is computed from angles."""
    rng = np.random.default_rng(1)
    corners = np.array([complex(*p) for p in points])
    for x, y in rng.uniform(-1, 21, (300, 2)) if points is STRIP else rng.uniform(-1, 6, (300, 2)):
        arms = corners - complex(x, y)
        turned = np.angle(np.roll(arms, -1) / arms).sum()
        assert in_polygon(points, x, y) == (abs(turned) > 3.0)


def test_fix_quality_in_the_tree_line_scenario_drops_only_below_trees():
    """Only the first pass of the simulated minute is below the trees."""
    log = run(load_scenario("tree_line", {"duration_s": 70}))
    signals = {column: log.signals[column].to_numpy() for column in log.signals.column_names}
    points = log.scenario.sensors.gnss.canopy[0].points
    below = np.array([in_polygon(points, x, y) for x, y in zip(signals["rear_x"], signals["rear_y"], strict=True)])
    assert below.sum() > 200
    assert (signals["gnss_quality"][below][5:-5] < Quality.FIX).all()
    assert (signals["gnss_quality"][:60] == Quality.FIX).all()
