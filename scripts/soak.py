"""Long runs: what a minute cannot show. Each prints a row for docs/reliability.md; the exit status is 1 if one fails.

    python scripts/soak.py link [--seconds 3600]

`link`: a host of our own drives over UDP at real time while other work loads the machine; ticks that come late, a
schedule that slips and outages of the watchdog are counted.
"""

import argparse
import json
import os
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

SAMPLE_S = 5.0
"""Wall time between two looks at the memory [s]."""


def resident_mb(process: int) -> float:
    """Memory that a process has in RAM [MB]; 0 once it has ended."""
    try:
        text = Path(f"/proc/{process}/status").read_text()
    except OSError:
        return 0.0
    return next((float(line.split()[1]) / 1e3 for line in text.splitlines() if line.startswith("VmRSS")), 0.0)


def free_ports() -> tuple[int, int]:
    """Two ports of UDP that nothing listens on."""
    with socket.socket(type=socket.SOCK_DGRAM) as a, socket.socket(type=socket.SOCK_DGRAM) as b:
        for each in (a, b):
            each.bind(("127.0.0.1", 0))
        return a.getsockname()[1], b.getsockname()[1]


def followed(command: list[str]) -> tuple[int, list[tuple[float, float]]]:
    """Run a command; its status, and time [s] and memory [MB] as it went."""
    began, samples = time.monotonic(), []
    with subprocess.Popen(command) as process:
        while process.poll() is None:
            samples.append((time.monotonic() - began, resident_mb(process.pid)))
            time.sleep(SAMPLE_S)
        return process.returncode, samples


def link(seconds: float) -> bool:
    """Drive over the link at real time; True if the host steered throughout and no outage was counted."""
    board, host = free_ports()
    lasting = ["--duration", str(seconds + 120), "--idle", "30"]
    serving = [sys.executable, "-m", "agrobot_mj.links.agopengps.host", f"--port={host}", f"--board-port={board}"]
    driving = [sys.executable, "-m", "agrobot_mj", "link", "straight_line", "--set", "guidance.position=paogi"]
    driving += ["--set", "terrain.half_size_m=10000"]
    ports = ["--port", str(board), "--host-port", str(host)]
    with tempfile.TemporaryDirectory() as folder, subprocess.Popen([*serving, *lasting]) as server:
        try:
            rest = ["--duration", str(seconds), "--start", "engaged", "--no-rrd", "--out", folder, *ports]
            status, samples = followed([*driving, *rest])
        finally:
            server.terminate()
        found: dict[str, Any] = json.loads((Path(folder) / "metrics.json").read_text())
    load = os.getloadavg()[2]
    keys = ("turns", "late_turns", "worst_lateness_ms", "slipped_s", "latency_ms_median", "latency_ms_p95")
    keys = (*keys, "latency_ms_worst", "positions", "steer_messages", "outages", "engaged_fraction")
    words = [f"{key} {found['link'][key]:.6g}" for key in keys]
    print(
        f"link: {found['outcome']}, status {status}, {', '.join(words)}, load {load:.1f}, "
        f"memory {samples[-2][1]:.0f} MB at the end, {max(m for _, m in samples):.0f} MB at most"
    )
    print(json.dumps([(round(t), round(m)) for t, m in samples[:: max(1, len(samples) // 60)]]))
    return status == 0 and found["link"]["outages"] == 0


def main() -> int:
    """Soak, and tell."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    kinds = parser.add_subparsers(dest="kind", required=True)
    kinds.add_parser("link").add_argument("--seconds", type=float, default=3600.0)
    given = parser.parse_args()
    return int(not link(given.seconds))


if __name__ == "__main__":
    raise SystemExit(main())
