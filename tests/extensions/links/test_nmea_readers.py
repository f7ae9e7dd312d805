"""NMEA output of the tractor, read by pynmeagps and, if installed, by gpsd."""

import json
import os
import shutil
import socket
import subprocess
import threading
import time
from math import atan2, degrees, pi

import numpy as np
import pytest

from agrobot_mj import load_scenario
from agrobot_mj.core.geodesy import Origin, to_local
from agrobot_mj.core.nmea import START
from agrobot_mj.extensions.links.agopengps.link import link
from agrobot_mj.extensions.links.agopengps.session import LinkOptions

SECONDS = 4.0
KEYS = {
    **{"guidance.kind": "agopengps", "plant.kind": "bicycle", "duration_s": SECONDS, "physics_dt_s": 0.005},
    "fault": [
        {"kind": "gnss_float", "start_s": 1.0, "end_s": 2.0},
        {"kind": "gnss_loss", "start_s": 2.0, "end_s": 3.0},
    ],
}
GPSD = shutil.which("gpsd", path=os.pathsep.join([os.environ.get("PATH", ""), "/usr/sbin"]))


def free_port(kind=socket.SOCK_DGRAM):
    with socket.socket(type=kind) as opened:
        opened.bind(("127.0.0.1", 0))
        return opened.getsockname()[1]


def sent_to(port, folder):
    """Return the log of a run without a host that sends its sentences to `port`."""
    scenario = load_scenario("circle", KEYS)
    arguments = LinkOptions(port=free_port(), host_port=free_port(), start="now", nmea=("127.0.0.1", port))
    return link(scenario, folder, arguments)


def place(log, latitude, longitude):
    """Return the east and north coordinates of a position [m]."""
    g = log.scenario.guidance
    return to_local(Origin(g.origin_lat_deg, g.origin_lon_deg), latitude, longitude)


def test_pynmeagps_reads_every_sentence(tmp_path):
    pynmeagps = pytest.importorskip("pynmeagps", reason="pynmeagps is not installed (uv sync, or make install)")
    with socket.socket(type=socket.SOCK_DGRAM) as receiver:
        receiver.bind(("127.0.0.1", 0))
        receiver.setblocking(False)
        log = sent_to(receiver.getsockname()[1], tmp_path)
        datagrams = []
        while True:
            try:
                datagrams.append(receiver.recv(4096))
            except BlockingIOError:
                break
    read = [pynmeagps.NMEAReader.parse(data, validate=pynmeagps.VALCKSUM) for data in datagrams]
    found = {kind: [m for m in read if m.msgID == kind] for kind in ("GGA", "RMC", "VTG")}
    assert {kind: len(messages) for kind, messages in found.items()} == dict.fromkeys(found, round(SECONDS * 10))
    quality = np.repeat([4, 5, 0, 4], 10)
    assert [m.quality for m in found["GGA"]] == quality.tolist()
    assert [m.status for m in found["RMC"]] == ["V" if q == 0 else "A" for q in quality]
    east, north = np.array([place(log, m.lat, m.lon) for m in found["GGA"] if m.quality]).T
    rows = np.flatnonzero(np.repeat(quality > 0, 2))[::2]
    np.testing.assert_allclose(east, log.column("gnss_x")[rows], atol=2e-4)
    np.testing.assert_allclose(north, log.column("gnss_y")[rows], atol=2e-4)
    assert found["RMC"][0].time == START.time()


@pytest.fixture
def gpsd(tmp_path):
    """Yield the reports of gpsd, and the port on which gpsd receives sentences."""
    if GPSD is None:
        pytest.skip("gpsd is not installed (Debian: apt install gpsd)")
    port, control = free_port(), free_port(socket.SOCK_STREAM)
    process = subprocess.Popen([GPSD, "-N", "-n", "-S", str(control), f"udp://127.0.0.1:{port}"], cwd=tmp_path)
    reports, done = [], threading.Event()

    def listen(stream):
        for line in stream.makefile():
            reports.append(json.loads(line))
            if done.is_set():
                return

    stream = connected(control)
    stream.sendall(b'?WATCH={"enable":true,"json":true};')
    thread = threading.Thread(target=listen, args=(stream,), daemon=True)
    thread.start()
    yield port, reports
    done.set()
    process.terminate()
    process.wait(timeout=300)
    stream.close()


def connected(port):
    for _ in range(600):
        try:
            return socket.create_connection(("127.0.0.1", port))
        except ConnectionRefusedError:
            time.sleep(0.1)
    raise AssertionError("gpsd does not answer")


def test_gpsd_reports_the_position_of_the_tractor(gpsd, tmp_path):
    port, reports = gpsd
    log = sent_to(port, tmp_path)
    time.sleep(0.5)
    timed = [report for report in reports if report["class"] == "TPV" and "time" in report]
    fixes = [report for report in timed if report["mode"] >= 2]
    assert len(fixes) >= 20
    status = {second: {f.get("status") for f in timed if f["time"][17:19] == f"{second:02d}"} for second in range(4)}
    assert status == {0: {3}, 1: {4}, 2: {None}, 3: {3}}, "gpsd's words for RTK fixed, floating, none, fixed"
    at = {round(float(t), 2): k for k, t in enumerate(log.column("t"))}
    off = []
    for report in fixes:
        time_of_day = report["time"].partition("T")[2].rstrip("Z").split(":")
        hours, minutes, seconds = (float(part) for part in time_of_day)
        row = at[round((hours - START.hour) * 3600 + minutes * 60 + seconds, 2)]
        x, y = place(log, report["lat"], report["lon"])
        off.append(np.hypot(x - log.column("gnss_x")[row], y - log.column("gnss_y")[row]))
    assert max(off) < 0.01
    last, end = fixes[-1], len(log.column("t")) - 1
    assert last["speed"] == pytest.approx(log.column("speed")[end], abs=0.15)
    course = degrees(pi / 2 - atan2(np.diff(log.column("y"))[-1], np.diff(log.column("x"))[-1])) % 360
    assert abs((last["track"] - course + 180) % 360 - 180) < 10
