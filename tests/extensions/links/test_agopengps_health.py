"""Messages and metrics of a link: latch, missing messages, start, waiting, cross-track error, and replay."""

import re
from math import degrees

import numpy as np
import pyarrow.parquet as pq
import pytest
from guide import Guide
from host import parser, settings_of
from look_ahead import Direct
from processes import free_ports

from agrobot_mj.core.agopengps.messages import Hello, Scan, ScanReply, SteerData
from agrobot_mj.core.agopengps.position import decode_position
from agrobot_mj.core.agopengps.traffic import Datagram
from agrobot_mj.core.agopengps.wire import decode, encode
from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.core.signals import TICK_S
from agrobot_mj.extensions.links.agopengps.link import link, run_link
from agrobot_mj.extensions.links.agopengps.link_check import check_lines
from agrobot_mj.extensions.links.agopengps.link_metrics import health, positions_since_heard, steering_rate
from agrobot_mj.extensions.links.agopengps.session import LinkOptions, NoHostError
from agrobot_mj.extensions.links.agopengps.udp import Incoming, UdpSockets
from agrobot_mj.scenario.loading import load_scenario

DUAL = "sensors.gnss.dual_antenna"
KEYS = {"guidance.kind": "agopengps", "guidance.position": "paogi", f"{DUAL}.enabled": True, "path.speed_m_s": 1.5}


def guide(*arguments):
    return Guide(settings_of(parser().parse_args(list(arguments))))


def scenario(duration_s, **keys):
    overrides = {key.replace("__", "."): value for key, value in keys.items()}
    return load_scenario("straight_line", {**KEYS, "plant.kind": "bicycle", "duration_s": duration_s, **overrides})


class Gap(Direct):
    """Host whose messages are lost for some time while it continues; only its bridge sends hello messages."""

    def __init__(self, guide, first, last):
        super().__init__(guide)
        self.first, self.last = first, last

    def rest(self, turn, answered):
        away = self.first <= turn * TICK_S < self.last
        if away:
            self.answers = [encode(Hello())]
        return super().rest(turn, answered)


def driven(channel, duration, start="heard", **keys):
    said = []
    done = run_link(scenario(duration, **keys), channel, LinkOptions(start=start, notify=said.append))
    return done, said


def test_unresponsive_host_is_not_reported_as_disengaged():
    done, said = driven(Gap(guide(), 4.0, 99.0), 12.0)
    assert any("the host is silent; the board has disengaged" in line for line in said)
    assert not any("the host has disengaged" in line for line in said)
    assert done.session.state.tally.hellos > 100
    assert done.log.outcome == "host_lost"


def test_host_that_never_engages_does_not_end_the_run():
    _, said = driven(Gap(guide("--engage-after", "100"), 4.0, 99.0), 9.0)
    assert [line.partition(": ")[2] for line in said if "silent" in line] == ["the host is silent"]


def test_run_ends_as_latched_if_a_lost_host_returns_engaged():
    done, said = driven(Gap(guide(), 4.0, 7.5), 14.0)
    (back,) = (line for line in said if "is back" in line)
    assert back.endswith("the host is back, but the board is latched; switch its autosteer button off and on")
    assert done.log.outcome == done.log.metrics["outcome"] == "latched"
    latched = done.log.metrics["link"]["latched_s"]
    assert latched == pytest.approx(14.0 - float(back.split()[0]), abs=0.11)
    assert said[-1] == f"for {latched:.1f} s the host reported active steering, but the board was latched"


@pytest.mark.parametrize("latch", [6.25, "never"])
def test_board_with_a_longer_latch_time_keeps_steering(latch):
    done, said = driven(Gap(guide(), 4.0, 7.5), 14.0, guidance__latch_s=latch)
    assert done.log.outcome == "completed"
    assert done.log.metrics["link"]["latched_s"] == 0.0
    assert [line.partition(": ")[2] for line in said[1:-1]] == [
        "the host has engaged",
        "the host is silent; the board has disengaged",
        "the host has engaged",
    ]
    assert said[-1].startswith("the host answered only 7")


def test_run_with_start_option_engaged_begins_when_the_host_engages():
    _, said = driven(Direct(guide()), 2.0, start="engaged")
    assert ["starts" in said[0], said[1]] == [True, "0.0 s: the host has engaged"]


class Bridge:
    """Bridge program that forwards messages, without a guidance program."""

    pace = None

    def begin(self, turn):
        return iter(())

    def rest(self, turn, answered):
        return iter([Incoming(turn * TICK_S, "127.0.0.1:9999", encode(Hello()))] if turn % 40 == 0 else [])

    def send(self, data, target=None):
        return 0.0, "127.0.0.1:9999"


@pytest.mark.parametrize(("host", "named"), [("agopengps", "AgIO answers"), ("agopenweb", "AgOpenWeb answers")])
def test_error_after_waiting_for_a_host_states_if_hellos_were_received(host, named):
    said = []
    with pytest.raises(NoHostError, match=rf"{named} \(5 hellos\), .* does not; open .* and switch its simulator off"):
        run_link(scenario(1.0, guidance__host=host), Bridge(), LinkOptions(wait_s=8.0, notify=said.append))
    assert len(said) == 1
    assert named in said[0]
    with pytest.raises(NoHostError, match="answers, but has not engaged"):
        run_link(scenario(1.0), Direct(guide("--engage-after", "99")), LinkOptions(start="engaged", wait_s=2.0))


class Scanning(Bridge):
    """Host that sends one scan message."""

    def __init__(self):
        self.sent = []

    def rest(self, turn, answered):
        messages = [encode(Scan()), encode(SteerData(1.0, 0, 0.0))] if turn == 0 else []
        return (Incoming(turn * TICK_S, "192.168.5.10:9999", message) for message in messages)

    def send(self, data, target=None):
        self.sent.append(data)
        return 0.0, "192.168.5.10:9999"


def test_scan_is_answered_with_the_address_of_the_board():
    channel = Scanning()
    run_link(scenario(0.1), channel, LinkOptions(), address=(192, 168, 5, 77))
    (reply,) = (found for data in channel.sent if isinstance(found := decode(data), ScanReply))
    assert reply == ScanReply(126, (192, 168, 5, 77), (192, 168, 5))


def test_board_has_the_address_of_the_interface_towards_the_host():
    own, other = free_ports()
    with UdpSockets("127.0.0.1", own, other) as sockets:
        assert sockets.address == (127, 0, 0, 1)


def headings(channel):
    return [found.attitude.yaw for _, data in channel.heard if (found := decode_position(data)) and found.dual]


class Listening(Direct):
    """Host that records the messages of the boards."""

    def __init__(self, guide):
        super().__init__(guide)
        self.heard = []

    def send(self, data, target=None):
        self.heard.append((self.turn, data))
        return super().send(data, target)


def test_heading_sent_to_the_host_includes_the_mounting_error():
    line = Listening(guide())
    keys = {f"{DUAL}.mounting_deg": 1.5, f"{DUAL}.wander_sigma_m": 0.0, f"{DUAL}.sigma_m": 0.001}
    log = run_link(scenario(3.0, **keys), line, LinkOptions()).log
    sent = np.degrees(headings(line)[-30:])
    assert sent[-1] == pytest.approx(degrees(log.column("gnss_heading")[-2]), abs=0.01)
    assert (sent - np.degrees(log.column("yaw")[-60::2])).mean() == pytest.approx(1.5, abs=0.05)


def test_last_heading_is_repeated_without_fixed_ambiguities():
    fault = [{"kind": "gnss_float", "start_s": 2.0, "end_s": 3.0}]
    line = Listening(guide())
    run_link(scenario(4.0, fault=fault), line, LinkOptions())
    found = headings(line)
    assert len(found) == 40
    assert len(set(found[20:30])) == 1
    assert len(set(found[:20])) > 15


def test_dual_antenna_sentence_without_dual_antenna_is_rejected():
    with pytest.raises(
        ScenarioError, match=r"guidance\.position: \"paogi\" needs sensors\.gnss\.dual_antenna\.enabled"
    ):
        scenario(1.0, **{f"{DUAL}.enabled": False})


def test_error_for_an_invalid_latch_time_names_the_key():
    with pytest.raises(ScenarioError) as error:
        scenario(1.0, guidance__latch_s="often")
    lines = str(error.value).splitlines()
    assert {line.split(": ")[1] for line in lines} == {"guidance.latch_s"}
    assert any("must be one of 'never', got 'often'" in line for line in lines)


@pytest.mark.parametrize("host", ["agopengps", "agopenweb"])
def test_cross_track_error_of_the_host_is_logged_and_a_metric(host):
    """The tractor is 0.6 m to the right of the path and of the host's line; logged errors are left positive."""
    keys = {"path__start_offset_m": -0.6, "guidance__host": host}
    log = run_link(scenario(40.0, **keys), Direct(guide("--dialect", host)), LinkOptions()).log
    t, off = log.column("t"), log.column("link_cross_track")
    assert off[t < 1].min() == pytest.approx(-0.6, abs=0.08)
    late = t > 25
    assert np.abs(off[late] - log.column("rear_y")[late]).max() < 0.1
    block = log.metrics["link"]
    assert block["cross_track_late_rms"] == pytest.approx(np.sqrt(np.mean(off[t > 21.05] ** 2)), rel=0.05)
    assert block["cross_track_late_rms"] < 0.05 < block["cross_track_rms"]
    assert 2 < block["cross_track_settled_s"] < 20


def test_host_cross_track_error_is_missing_without_line_or_messages():
    done, _ = driven(Gap(guide(), 4.0, 99.0), 9.0)
    t, off = done.log.column("t"), done.log.column("link_cross_track")
    assert np.isnan(off[t > 7.0]).all()
    assert not np.isnan(off[(t > 2) & (t < 6)]).any()


def out(turn):
    return Datagram(turn, turn * 0.05, "out", "h:1", b"$PANDA,")


def answer(turn):
    return Datagram(turn, turn * 0.05 + 0.01, "in", "h:1", encode(SteerData(1.0, 0, 0.0)))


def test_answered_fraction_excludes_positions_before_the_first_reply():
    record = [out(0), out(2), out(4), answer(4), out(6), out(8), answer(8)]
    assert positions_since_heard(record) == 3
    assert positions_since_heard(record[:3]) == 0


def test_rate_of_steering_messages_excludes_the_wait_for_the_host():
    late = [out(0), out(100), answer(200), out(202), answer(202), answer(204), out(400)]
    assert steering_rate(late) == pytest.approx(10.0)
    assert steering_rate(late[:3]) is None
    assert steering_rate(late[:2]) is None


def test_slow_or_lossy_link_to_the_host_is_reported():
    well = {"answered_fraction": 0.97, "latched_s": 0.0, "real_time_factor": 0.99}
    assert health(well) == []
    (slow,) = health(well | {"real_time_factor": 0.42})
    assert slow.startswith("the run was slow (0.42 x real time)")
    (deaf,) = health(well | {"answered_fraction": 0.61})
    assert deaf.startswith("the host answered only 61 % of the positions")
    assert deaf.endswith("or use --pace 0.5")
    assert health(well | {"pace": 0.5, "real_time_factor": 0.5}) == []
    assert health({"answered_fraction": None, "latched_s": 0.0}) == []


class Deaf(Direct):
    """Host that receives only every third position."""

    def send(self, data, target=None):
        self.cut = self.turn % 6 != 0
        return super().send(data, target)


def test_fraction_of_positions_answered_by_the_host_is_a_metric():
    done, said = driven(Deaf(guide()), 9.0)
    assert done.log.metrics["link"]["answered_fraction"] == pytest.approx(1 / 3, abs=0.03)
    assert said[-1].startswith("the host answered only 33 % of the positions")
    done, _ = driven(Direct(guide()), 3.0)
    assert done.log.metrics["link"]["answered_fraction"] == 1.0


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """Return the folder of a recorded run of 3 s."""
    folder = tmp_path_factory.mktemp("recorded")
    done = run_link(scenario(3.0), Direct(guide()), LinkOptions())
    table = done.session.traffic.table(done.session.started, scenario(3.0).portable()[0])
    pq.write_table(table, folder / "link.parquet")
    return folder


def test_replay_with_a_different_scenario_is_rejected(recorded, tmp_path):
    replay = LinkOptions(replay=recorded / "link.parquet")
    link(scenario(2.0), tmp_path, replay)
    with pytest.raises(
        ScenarioError, match=r"the record has path\.speed_m_s = 1\.5, but the scenario has 2\.0; replay the record"
    ):
        link(scenario(3.0, path__speed_m_s=2.0), tmp_path, replay)
    with pytest.raises(ScenarioError, match=r"the record has .* \(and \d+ more\)"):
        link(scenario(3.0, plant__kind="mujoco", terrain__kind="slope"), tmp_path, replay)


def test_link_recording_without_metadata_is_checked_by_its_scenario_file(recorded, tmp_path):
    bare = pq.read_table(recorded / "link.parquet").replace_schema_metadata(None)
    pq.write_table(bare, tmp_path / "link.parquet")
    replay = LinkOptions(replay=tmp_path / "link.parquet")
    link(scenario(1.0, seed=4), tmp_path / "out", replay)
    (tmp_path / "scenario.toml").write_text(scenario(3.0).portable()[0])
    with pytest.raises(ScenarioError, match="the record has seed = 1, but the scenario has 4"):
        link(scenario(1.0, seed=4), tmp_path / "out", replay)


def test_scenario_with_other_guidance_is_rejected_before_opening_a_port(tmp_path):
    said = []
    with pytest.raises(ScenarioError, match="is not supported by a link"):
        link(load_scenario("straight_line"), tmp_path, LinkOptions(notify=said.append))
    assert said == []


def test_axle_offset_due_to_an_antenna_offset_is_reported_as_a_metric():
    """The antenna is 0.3 m left of the centre line, unknown to the host, so the axle is 0.3 m right of its line."""
    done, said = driven(Direct(guide()), 40.0, tractor__antenna_left_m=0.3)
    assert done.log.metrics["link"]["cross_track_offset"] == pytest.approx(-0.3, abs=0.04)
    far = round(-100 * done.log.metrics["link"]["cross_track_offset"])
    assert any(line.startswith(f"the rear axle is {far} cm right of its position in the host") for line in said)
    done, said = driven(Direct(guide()), 40.0)
    assert abs(done.log.metrics["link"]["cross_track_offset"]) < 0.04
    assert not any("rear axle" in line for line in said)


PLACE = {"tractor__antenna_ahead_m": 0.8, "tractor__antenna_left_m": -0.3}


def test_check_reports_rate_wheelbase_antenna_and_missing_signals():
    used = scenario(20.0, path__start_offset_m=1.0, tractor__wheelbase_m=1.7, **PLACE)
    log = run_link(used, Direct(guide()), LinkOptions()).log
    rate, latency, wheelbase, _, antenna, *missing = check_lines(used, log, log.metrics["link"])
    assert "100 % of the positions were answered" in rate
    assert latency.startswith("latency: median")
    found = float(wheelbase.partition("; ")[2].split()[0])
    assert wheelbase.startswith("wheelbase: 1.7 m; ")
    assert found == pytest.approx(1.7, rel=0.05)
    given, _, estimated = antenna.partition("; ")
    assert given == "antenna: 0.8 m ahead of the rear axle, -0.3 m left"
    numbers = list(map(float, re.findall(r"-?\d+\.\d+", estimated)))
    for true, value, half in zip(PLACE.values(), numbers[::2], numbers[1::2], strict=True):
        assert abs(value - true) < half < 0.1
    assert any("sensors.imu" in line for line in missing)
    assert not any("engagement" in line for line in missing)


def test_check_of_a_straight_drive_does_not_identify_antenna_position():
    used = scenario(20.0, tractor__antenna_ahead_m=0.8)
    log = run_link(used, Direct(guide()), LinkOptions()).log
    assert list(check_lines(used, log, log.metrics["link"]))[4].endswith("not identifiable without bends")


def test_check_with_a_silent_host_lists_the_missing_signals():
    used = scenario(3.0, guidance__position="panda")
    log = run_link(used, Gap(guide(), 0.0, 99.0), LinkOptions(start="now")).log
    lines = list(check_lines(used, log, log.metrics["link"]))
    assert "does not confirm" in lines[0]
    assert [line.split()[1].strip(";") for line in lines[3:]] == ["engagement", "roll", "heading"]
