"""Path sections of runs: equal for any speed, and different for another length or another path."""

from agrobot_mj import load_scenario
from agrobot_mj.studies.pieces import at_speed, pieces


def of(**overrides):
    return load_scenario("figure_eight", {key.replace("__", "."): value for key, value in overrides.items()})


def test_driven_path_section_depends_on_speed_only_for_fixed_durations():
    whole = [of(), of(path__speed_m_s=0.8), of(plant__kind="bicycle", seed=7)]
    assert pieces(whole) == [1, 1, 1]
    timed = [of(duration_s=20.0), of(duration_s=20.0, path__speed_m_s=0.8), at_speed(of(duration_s=20.0), 0.8)]
    assert pieces([*whole, *timed]) == [1, 1, 1, 2, 3, 2]


def test_runs_on_different_paths_have_different_path_section_numbers():
    assert pieces([of(), of(path__radius_m=11.0), of(path__kind="circle"), of()]) == [1, 2, 3, 1]
