"""Sockets on loopback, and the record of datagrams."""

import socket
import time

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from agrobot_mj.core.agopengps.traffic import Datagram, Traffic, read_traffic
from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.extensions.links.agopengps.udp import LOOPBACK, UdpSockets
from agrobot_mj.extensions.links.pacing import Pace


def free_port():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def test_datagrams_to_every_loopback_address_are_received():
    port = free_port()
    with UdpSockets("127.0.0.1", port, free_port()) as sockets, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
        out.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
        for address in LOOPBACK:
            out.sendto(address.encode(), (address, port))
        got = {received.data.decode() for received in sockets.receive(time.perf_counter() + 0.2)}
    assert got == set(LOOPBACK)


def test_second_link_on_the_same_port_is_rejected():
    port = free_port()
    with (
        UdpSockets("127.0.0.1", port, 9),
        pytest.raises(ScenarioError, match=rf"127\.0\.0\.1:{port} is in use .*--port"),
    ):
        UdpSockets("127.0.0.1", port, 9)
    with UdpSockets("127.0.0.1", port, 9):
        pass


def test_link_listens_only_on_loopback_by_default():
    with UdpSockets("127.0.0.1", free_port(), 9) as sockets:
        assert all(each.getsockname()[0].startswith("127.") for each in sockets.sockets)


@pytest.mark.parametrize("text", ["localhost", "127.0.0", "::1", "999.1.1.1", ""])
def test_address_that_is_not_a_numeric_ipv4_address_is_rejected(text):
    with pytest.raises(ScenarioError, match=r"--address: .* is not an IPv4 address"):
        UdpSockets(text, free_port(), 9)


def test_datagrams_above_the_limit_per_cycle_are_received_in_the_next():
    port = free_port()
    with UdpSockets("127.0.0.1", port, 9) as sockets, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
        for n in range(150):
            out.sendto(bytes((n,)), ("127.0.0.1", port))
        first = list(sockets.receive(0.0, most=100))
        second = list(sockets.receive(0.0, most=100))
    assert [len(first), len(second)] == [100, 50]
    assert [received.data[0] for received in first + second] == list(range(150))


def test_receive_without_datagrams_returns_at_the_specified_time():
    with UdpSockets("127.0.0.1", free_port(), 9) as sockets:
        began = time.perf_counter()
        assert list(sockets.receive(began + 0.05)) == []
        assert time.perf_counter() - began > 0.045


def test_late_cycles_are_counted_and_shift_all_later_cycles():
    pace = Pace(0.02)
    pace.begin()
    first = pace.next - pace.period
    time.sleep(0.1)
    behind = pace.begin()
    assert pace.next == pytest.approx(first + pace.period + behind + pace.period)
    assert (pace.turns, pace.late) == (2, 1)
    assert pace.worst == pytest.approx(pace.slipped)
    assert pace.worst == behind > 0.07


def test_loading_time_before_the_first_cycle_is_not_counted_as_delay():
    pace = Pace(0.02)
    made = pace.next
    time.sleep(0.1)
    pace.begin()
    assert (pace.turns, pace.late, pace.worst, pace.slipped) == (1, 0, 0.0, 0.0)
    assert pace.next > made + 0.1


def test_traffic_recording_is_read_back_unchanged(tmp_path):
    traffic = Traffic()
    kept = [Datagram(4, 0.2, "out", "127.0.0.1:9999", b"$P"), Datagram(7, 0.35, "in", "127.0.0.1:9999", b"\x80\x00")]
    for datagram in kept:
        traffic.add(datagram)
    table = traffic.table(start=6)
    assert table["t"].to_pylist() == pytest.approx([-0.1, 0.05])
    pq.write_table(table, tmp_path / "link.parquet")
    assert read_traffic(tmp_path / "link.parquet") == [kept[0]._replace(turn=0), kept[1]._replace(turn=3)]


def test_traffic_recording_without_datagrams_is_valid(tmp_path):
    pq.write_table(Traffic().table(0), tmp_path / "link.parquet")
    assert read_traffic(tmp_path / "link.parquet") == []


def test_invalid_traffic_recording_is_rejected(tmp_path):
    with pytest.raises(ScenarioError, match=r"no such file; specify the link.parquet"):
        read_traffic(tmp_path / "none.parquet")
    (tmp_path / "text.parquet").write_text("t,wall_s")
    pq.write_table(pa.table({"t": [0.0]}), tmp_path / "other.parquet")
    empty = Traffic()
    empty.add(Datagram(0, 0.0, "in", None, b""))
    pq.write_table(empty.table(0), tmp_path / "empty.parquet")
    for name in ("text", "other", "empty"):
        with pytest.raises(ScenarioError, match=rf"{name}\.parquet: this is not the link\.parquet of a run"):
            read_traffic(tmp_path / f"{name}.parquet")
