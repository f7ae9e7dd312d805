from agrobot_mj import load_scenario, run
from agrobot_mj.recording import Recording

MOST_MB, FULL_S, PIECE_S = 12.0, 240, 40


def test_recording_of_a_figure_eight_is_below_the_size_limit(tmp_path):
    sizes = []
    for duration_s in (PIECE_S, 2 * PIECE_S):
        path = tmp_path / f"{duration_s}.rrd"
        run(load_scenario("figure_eight", {"duration_s": duration_s}), (Recording(path),))
        sizes.append(path.stat().st_size / 1e6)
    grows = (sizes[1] - sizes[0]) / PIECE_S
    assert grows > 0
    assert sizes[1] + grows * (FULL_S - 2 * PIECE_S) < MOST_MB
