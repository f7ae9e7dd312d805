"""Machines with random sensors in the simulator: the intervals of a calibration contain the true values.

`drawn.py` creates the machines. The page of the extension has the table of the slow test.
"""

from collections import Counter
from math import hypot

import pytest
from drawn import calibrated, drawn, errors, owned

from agrobot_mj.core.table_columns import FieldLogError
from agrobot_mj.extensions.logs.calibrate import calibrate

FEW = (0, 3)  # Machines of the quick tests: the speed of a receiver with a gyro, and two scales with a wheel speed
BRIEFLY_S = 70.0


def test_identified_values_of_random_machines_lie_in_their_intervals():
    for seed in FEW:
        found = errors(seed, BRIEFLY_S)
        outside = {key: each for key, each in found.items() if abs(each[0]) > each[1]}
        assert len(outside) <= 1, outside
        assert all(abs(off) < 1.5 * half for off, half, _ in found.values())
        assert sum(told for *_, told in found.values()) >= len(found) - 1


def test_identifications_from_two_drives_agree_within_their_intervals():
    one, other = (calibrated(FEW[0], BRIEFLY_S, again).found for again in (0, 1))
    for key in one.keys() & other.keys():
        assert abs(one[key].value - other[key].value) < hypot(one[key].half, other[key].half), key


def test_log_with_one_fix_per_second_is_rejected_with_its_fix_rate():
    log = owned(0, 40.0, drawn(0)._replace(position_hz=1))
    with pytest.raises(FieldLogError, match=r"the rate of \[position\] is 1 Hz, but a fit needs 2\.5 Hz"):
        calibrate([log.table], log.log_map, log.scenario)


@pytest.mark.slow
def test_intervals_contain_the_true_value_for_90_of_100_random_machines():
    """At least 90 of 100 intervals of 95 % contain the true value with a probability of 99 %."""
    inside, told = Counter[str](), Counter[str]()
    for seed in range(100):
        for key, (off, half, identified) in errors(seed, 80.0).items():
            told[key] += identified
            inside[key] += identified and abs(off) < half
    print({key: f"{inside[key]} of {told[key]}" for key in told})
    assert all(inside[key] >= 0.9 * told[key] for key in told)
