"""Runs over the link: convergence, outages, replay, hostile messages, and hosts in this and other processes."""

import subprocess
import sys
from math import isnan, radians
from random import Random

import numpy as np
import pyarrow.parquet as pq
import pytest
import soak
from doubles import Toy, host_process
from guide import Guide
from host import parser, settings_of
from look_ahead import Direct
from processes import free_ports
from typer.testing import CliRunner

from agrobot_mj import run
from agrobot_mj.cli import app
from agrobot_mj.cli.runs import variants
from agrobot_mj.core.agopengps.messages import SteerData
from agrobot_mj.core.agopengps.position import decode_position
from agrobot_mj.core.agopengps.wire import decode, encode
from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.core.signals import NEUTRAL_V, TICK_S
from agrobot_mj.extensions.links.agopengps.board import Board
from agrobot_mj.extensions.links.agopengps.channels import Answered, RealTime, Replayed
from agrobot_mj.extensions.links.agopengps.link import link, run_link
from agrobot_mj.extensions.links.agopengps.session import LinkOptions, NoHostError, Session
from agrobot_mj.extensions.links.agopengps.udp import Incoming, UdpSockets
from agrobot_mj.extensions.links.agopengps_guidance import AgOpenGps
from agrobot_mj.scenario.loading import load_scenario
from agrobot_mj.simulation.results import MARK
from agrobot_mj.studies.compare_plan import plan

LIMIT = radians(45)
BESIDE = {"path.start_offset_m": 1.0, "path.speed_m_s": 1.5, "guidance.position": "paogi"}
"""Scenario keys of a tractor that starts one metre to the left of the host's line."""
DUAL = "sensors.gnss.dual_antenna.enabled"


def guide(*arguments):
    return Guide(settings_of(parser().parse_args(list(arguments))))


def scenario(name="straight_line", **keys):
    overrides = {key.replace("__", "."): value for key, value in keys.items()}
    return load_scenario(name, {"guidance.kind": "agopengps", DUAL: True, **BESIDE, **overrides})


def toy_session(keys, *arguments, duration=30.0, channel=None):
    vehicle = Toy(duration)
    board = Board(AgOpenGps(**keys), LIMIT)
    session = Session(vehicle, board, channel or Direct(guide(*arguments)), LinkOptions())
    session.run()
    return vehicle, session


@pytest.mark.parametrize("host", ["agopengps", "agopenweb"])
@pytest.mark.parametrize("law", ["pure_pursuit", "stanley"])
def test_offset_from_the_host_line_stays_below_5_mm_after_20_s(law, host):
    vehicle, session = toy_session({"position": "paogi", "host": host}, "--law", law, "--dialect", host)
    off = np.array([y for t, _, y in vehicle.track if t > 20])
    assert np.abs(off).max() < 0.005
    assert session.ended is None
    assert session.state.tally.steer_data == 300


def test_tractor_follows_the_host_line_with_one_antenna_and_no_imu():
    vehicle, _ = toy_session({}, "--look-ahead", "4")
    assert max(abs(y) for t, _, y in vehicle.track if t > 25) < 0.05


def test_steering_law_of_the_board_brings_the_tractor_to_the_line():
    vehicle, session = toy_session({"position": "paogi", "steer_by": "pwm"}, "--board", "40", "255", "10")
    assert max(abs(y) for t, _, y in vehicle.track if t > 20) < 0.03
    assert session.state.settings.high_pwm == 255


def test_host_with_the_wrong_protocol_variant_never_steers():
    _, session = toy_session({"host": "agopenweb"}, "--dialect", "agopengps", duration=5.0)
    assert session.ended == "not_engaged"


def test_no_position_is_sent_to_the_host_without_a_gnss_solution():
    class Blind(Toy):
        def _measure(self):
            measured = super()._measure()
            return measured._replace(fix=None, quality=0) if 40 <= round(self.t / TICK_S) < 80 else measured

    vehicle = Blind(6.0 - TICK_S / 2)
    session = Session(vehicle, Board(AgOpenGps(), LIMIT), Direct(guide()), LinkOptions(nmea=("127.0.0.1", 1)))
    session.run()
    start = session.started
    positions = [d.turn - start for d in session.traffic.kept if d.data.startswith(b"$PANDA")]
    assert positions == [n for n in range(0, 120, 2) if not 40 <= n < 80]
    lost = [d for d in session.traffic.kept if d.data.startswith(b"$GPRMC") and b",V," in d.data]
    assert len(lost) == 20


def test_imu_data_are_sent_together_with_the_position():
    keys = {"sensors__imu__enabled": True, "sensors__gyro__enabled": True, "guidance__position": "panda"}
    with_unit = run_link(scenario(duration_s=1.0, **keys), Direct(guide()), LinkOptions())
    position = decode_position(with_unit.session.traffic.kept[0].data)
    assert position.attitude.yaw == pytest.approx(0.0, abs=radians(1))
    assert not isnan(position.attitude.roll)
    without = run_link(scenario(duration_s=1.0, guidance__position="panda"), Direct(guide()), LinkOptions())
    attitude = decode_position(without.session.traffic.kept[0].data).attitude
    assert isnan(attitude.yaw)
    assert attitude.roll == 0.0


def test_antenna_tilt_error_is_corrected_only_if_the_host_receives_roll():
    """On a slope of 5 deg, an antenna at a height of 2 m is displaced by 17 cm."""
    keys = {"path__start_offset_m": 0.0, "duration_s": 40.0}
    offs = []
    for enabled in (False, True):
        overrides = keys | {"sensors__imu__enabled": enabled, "sensors__imu__wander_sigma_deg": 0.0}
        log = run_link(scenario("side_slope_5", **overrides), Direct(guide()), LinkOptions()).log
        offs.append(log.column("rear_y")[-400:].mean())
    lean = 2.0 * np.sin(np.abs(log.column("roll")[-400:]).mean())
    assert abs(offs[1] - offs[0]) == pytest.approx(lean, abs=0.03)
    assert abs(offs[1]) < abs(offs[0])


@pytest.fixture(scope="module")
def driven(tmp_path_factory):
    """Return log and folder of a run with a host in another process, over UDP on loopback."""
    folder = tmp_path_factory.mktemp("driven")
    own, other = free_ports()
    arguments = LinkOptions(port=own, host_port=other, pace="answered")
    with host_process(other, own):
        log = link(scenario(duration_s=45.0), folder, arguments)
    return log, folder


def test_line_followed_over_udp_stays_within_5_cm_after_20_m(driven):
    log, _ = driven
    assert log.outcome == "completed"
    far = log.column("rear_x") > 20
    assert far.sum() > 500
    assert np.abs(log.column("rear_y")[far]).max() < 0.05
    assert np.abs(log.column("y")[far]).max() < 0.05


def test_metrics_of_a_linked_run_contain_link_statistics(driven):
    log, _ = driven
    block = log.metrics["link"]
    assert block["positions"] >= block["steer_messages"] >= 445
    assert block["engaged_s"] == pytest.approx(44.0, abs=0.3)
    assert 0 < block["latency_ms_median"] < block["latency_ms_worst"]
    assert (block["outages"], block["engagements"], block["rejected_datagrams"]) == (0, 1, {})


def test_log_contains_the_setpoint_of_the_host(driven):
    log, _ = driven
    engaged = log.column("link_engaged") > 0
    np.testing.assert_allclose(log.column("steer_ref")[engaged], log.column("link_steer")[engaged], atol=1e-9)
    waiting = ~engaged & ~np.isnan(log.column("link_steer"))
    assert waiting.any()
    assert (log.column("valve_voltage")[waiting] == NEUTRAL_V).all()


def test_replay_of_recorded_traffic_gives_bit_identical_signals(driven, tmp_path):
    log, folder = driven
    again = link(scenario(duration_s=45.0), tmp_path, LinkOptions(replay=folder / "link.parquet"))
    assert again.signals.equals(log.signals)
    assert again.outcome == log.outcome
    assert again.metrics["link"]["latency_ms_worst"] == log.metrics["link"]["latency_ms_worst"]
    table = pq.read_table(folder / "link.parquet")
    assert set(table["direction"].to_pylist()) == {"in", "out"}
    assert table["t"].to_pylist() == sorted(table["t"].to_pylist())


class Interrupted(Answered):
    """Link that kills the process of its host after the host has commanded 8 deg for a second."""

    def __init__(self, sockets, process):
        super().__init__(sockets)
        self.process, self.asked = process, 0

    def rest(self, turn, answered):
        for incoming in super().rest(turn, answered):
            message = decode(incoming.data)
            self.asked += isinstance(message, SteerData) and message.status == 1 and abs(message.steer) > radians(8)
            yield incoming
        if self.asked == 10:
            self.process.kill()


def test_host_killed_in_a_turn_leaves_the_valve_neutral_and_latched(tmp_path):
    own, other = free_ports()
    with host_process(other, own) as process, UdpSockets("127.0.0.1", own, other) as sockets:
        line = Interrupted(sockets, process)
        done = run_link(scenario(duration_s=30.0, guidance__give_up_s=5.0), line, LinkOptions())
    log = done.log
    t, engaged, volts = (log.column(name) for name in ("t", "link_engaged", "valve_voltage"))
    silent = max(d.turn for d in done.session.traffic.kept if d.direction == "in") - done.session.started
    released = int(np.flatnonzero(engaged)[-1]) + 1
    assert np.abs(np.degrees(log.column("steer")[silent])) > 3
    assert 2.4 < t[released] - t[silent] <= 2.5 + TICK_S + 1e-9
    assert (volts[released:] == NEUTRAL_V).all()
    assert t[-1] - t[silent] == pytest.approx(5.0, abs=0.1)
    assert log.outcome == "host_lost"
    assert log.metrics["outcome"] == "host_lost"
    assert log.metrics["link"]["outages"] == 1


def test_reconnected_host_steers_only_after_disengaging():
    class Cut(Direct):
        """Host that is silent for four seconds, remains engaged, and disengages for half a second at 12 s."""

        def send(self, data, target=None):
            t = self.turn * TICK_S
            self.cut = 4 <= t < 8
            answer = super().send(data, target)
            if 12 <= t < 12.5:
                self.answers = [bytes_without_engagement(a) for a in self.answers]
            return answer

    log = run_link(scenario(duration_s=16.0), Cut(guide("--engage-after", "1")), LinkOptions()).log
    t, engaged = log.column("t"), log.column("link_engaged") > 0
    assert engaged[(t > 1.2) & (t < 6.3)].all()
    assert not engaged[(t > 6.6) & (t < 12.4)].any()
    assert engaged[t > 12.7].all()
    assert log.outcome == "completed"
    assert (log.metrics["link"]["outages"], log.metrics["link"]["engagements"]) == (1, 2)


def bytes_without_engagement(datagram):
    message = decode(datagram)
    return encode(message._replace(status=0)) if isinstance(message, SteerData) else datagram


class Hostile(Direct):
    """Host whose messages are each accompanied by nine datagrams of noise and damaged frames."""

    random = Random(2)

    def rest(self, turn, answered):
        for incoming in super().rest(turn, answered):
            for _ in range(9):
                noise = bytearray(incoming.data)
                noise[self.random.randrange(len(noise))] ^= 1 << self.random.randrange(8)
                noise = noise if self.random.random() < 0.7 else self.random.randbytes(self.random.randint(0, 1400))
                yield Incoming(incoming.wall, "127.0.0.1:5", bytes(noise))
            yield incoming


def test_malformed_datagrams_leave_the_run_bit_identical():
    clean = run_link(scenario(duration_s=20.0), Direct(guide()), LinkOptions()).log
    noisy = run_link(scenario(duration_s=20.0), Hostile(guide()), LinkOptions()).log
    assert noisy.signals.equals(clean.signals)
    assert sum(noisy.metrics["link"]["rejected_datagrams"].values()) > 1500


def test_run_without_a_host_does_not_start():
    own, other = free_ports()
    with (
        UdpSockets("127.0.0.1", own, other) as sockets,
        pytest.raises(NoHostError, match=r"has answered within 0\.5 s"),
    ):
        run_link(scenario(), RealTime(sockets), LinkOptions(wait_s=0.5))
    with pytest.raises(NoHostError, match="has answered"):
        run_link(scenario(), Replayed([]), LinkOptions())
    with pytest.raises(NoHostError, match="has engaged"):
        run_link(scenario(), Direct(guide("--engage-after", "100")), LinkOptions(start="engaged", wait_s=1.0))


def test_run_starts_at_host_engagement_or_immediately_as_configured():
    log = run_link(scenario(duration_s=2.0), Direct(guide()), LinkOptions(start="engaged")).log
    assert (log.column("link_engaged")[:-1] == 1).all()
    assert log.metrics["link"]["waited_s"] == pytest.approx(1.0, abs=0.11)
    log = run_link(scenario(duration_s=1.0), Replayed([]), LinkOptions(start="now")).log
    assert log.outcome == "not_engaged"


def test_real_time_run_keeps_pace_with_the_clock_and_reports_delays():
    own, other = free_ports()
    with host_process(other, own), UdpSockets("127.0.0.1", own, other) as sockets:
        log = run_link(scenario(duration_s=2.0), RealTime(sockets), LinkOptions()).log
    block = log.metrics["link"]
    assert log.wall_s > 1.9
    assert block["turns"] >= 40
    assert block["late_turns"] <= block["turns"]
    assert block["worst_lateness_ms"] >= 0
    assert block["steer_messages_hz"] < 12


def test_run_at_half_of_real_time_pace_takes_twice_as_long():
    own, other = free_ports()
    with host_process(other, own), UdpSockets("127.0.0.1", own, other) as sockets:
        log = run_link(scenario(duration_s=1.0), RealTime(sockets, 2.0), LinkOptions(pace=0.5)).log
    block = log.metrics["link"]
    assert log.wall_s > 1.9
    assert block["pace"] == 0.5
    assert 0.1 < block["real_time_factor"] <= 0.5


@pytest.mark.parametrize("pace", ["0", "2", "fast", "nan"])
def test_invalid_value_of_the_pace_option_is_rejected(call, pace):
    status, out, err = call("link", "figure_eight", "--pace", pace)
    assert (status, out) == (2, "")
    assert f"--pace {pace}: specify real_time, answered, or a number from 0.05 to 1" in err


def test_host_program_exits_after_its_idle_time():
    own, other = free_ports()
    with host_process(other, own, "--idle", "0.3") as process, UdpSockets("127.0.0.1", own, other) as sockets:
        run_link(scenario(duration_s=1.0), Answered(sockets), LinkOptions())
        assert process.wait(timeout=300) == 0


def test_second_host_on_the_same_port_is_rejected():
    own, other = free_ports()
    with UdpSockets("127.0.0.1", other, own), host_process(other, own) as second:
        _, said = second.communicate(timeout=300)
    assert second.returncode == 2
    assert f"127.0.0.1:{other} is in use" in said
    assert "Traceback" not in said


def command(*arguments):
    return subprocess.run(
        [sys.executable, "-m", "agrobot_mj", "link", *arguments], capture_output=True, text=True, timeout=600
    )


def test_second_link_on_the_same_port_is_rejected():
    own, other = free_ports()
    with UdpSockets("127.0.0.1", own, other):
        done = command("straight_line", f"--port={own}", f"--host-port={other}", "--no-rrd")
    assert done.returncode == 2
    assert f"127.0.0.1:{own} is in use by another link" in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--address", "tractor"], "--address: 'tractor' is not an IPv4 address"),
        (["--nmea", "10110"], "--nmea 10110: specify the address and port, for example 127.0.0.1:10110"),
        (["--nmea", "here:10110"], "--nmea: 'here' is not an IPv4 address"),
        (["--port", "70000"], "Invalid value for '--port'"),
        (["--host-port", "0"], "Invalid value for '--host-port'"),
    ],
)
def test_invalid_link_arguments_are_reported(arguments, message, tmp_path):
    done = CliRunner().invoke(app, ["link", "straight_line", *arguments, "--out", str(tmp_path / "run")])
    assert message in (done.output if isinstance(done.exception, SystemExit) else str(done.exception))
    assert isinstance(done.exception, ScenarioError | SystemExit)
    assert not (tmp_path / "run").exists()


def test_run_command_rejects_guidance_that_needs_a_link():
    with pytest.raises(ScenarioError, match="needs an external program; use `agrobot-mj link`"):
        run(scenario(duration_s=1.0))
    compared = variants(["a: guidance.kind=agopengps"])
    with pytest.raises(ScenarioError, match=r"--variant 'a': .*; use `agrobot-mj link`"):
        plan(load_scenario("circle", {"plant.kind": "bicycle"}), variants=compared, plants=["bicycle"])
    with pytest.raises(ScenarioError, match=r'guidance\.kind: "kinematic" is not supported by a link'):
        run_link(load_scenario("straight_line"), Replayed([]), LinkOptions())


def test_link_command_completes_a_run_steered_by_a_host(tmp_path):
    own, other = free_ports()
    with host_process(other, own):
        sets = ("--set", "guidance.position=paogi", "--set", f"{DUAL}=true")
        options = ("--pace=answered", "--duration=5", "--steer-by=pwm", "--no-rrd", "--out", str(tmp_path))
        done = command("straight_line", *sets, f"--port={own}", f"--host-port={other}", *options)
    assert done.returncode == 0, done.stderr
    assert "the host has engaged" in done.stderr
    assert "engaged 4.0 s" in done.stdout
    assert {path.name for path in tmp_path.iterdir()} == {
        *("signals.parquet", "metrics.json", "scenario.toml", "link.parquet", MARK)
    }


def test_link_soak_test_runs_without_outages(capfd):
    assert soak.link(2.0)
    out = capfd.readouterr().out
    assert "link: completed, status 0" in out
    assert "outages 0" in out
