"""Display of a recording without an end, up to its last complete chunk; the file itself is not changed."""

import numpy as np
import pytest
from recorded import Recorded

from agrobot_mj.recording.transport.mending import ends_well, whole

ERROR = "/plots/tracking/error", "Scalars:scalars"


def test_complete_recording_is_opened_without_repair(eight, capsys):
    assert ends_well(eight.path)
    with whole(eight.path) as readable:
        assert readable == eight.path
    assert capsys.readouterr().err == ""


@pytest.mark.filterwarnings("ignore:RRD file has no footer")
@pytest.mark.parametrize("share", [0.4, 0.63, 0.9])
def test_recording_truncated_within_a_chunk_is_readable_up_to_this_chunk(eight, tmp_path, capsys, share):
    content = eight.path.read_bytes()
    cut = tmp_path / "cut.rrd"
    cut.write_bytes(content[: int(share * len(content))])
    with whole(cut) as readable:
        assert readable != cut
        times, values = Recorded(readable).column(*ERROR)
        kept = readable.parent
    assert not kept.exists()
    assert len(cut.read_bytes()) == int(share * len(content))
    assert "cut.rrd: the recording is incomplete" in capsys.readouterr().err
    all_times, all_values = eight.column(*ERROR)
    assert len(times) > 0.2 * share * len(all_times)
    np.testing.assert_array_equal(times, all_times[: len(times)])
    np.testing.assert_array_equal(values, all_values[: len(times)])


def test_unrepairable_recording_is_passed_to_the_viewer_unchanged(tmp_path, capsys):
    file = tmp_path / "bad.rrd"
    file.write_bytes(b"RRF2" + bytes(100))
    with whole(file) as readable:
        assert readable == file
    assert capsys.readouterr().err == ""
