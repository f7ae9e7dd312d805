"""Long runs that reveal faults which do not occur within a minute. Each run prints a row for docs/reliability.md. A
fault gives exit status 1.

    python tests/soak.py learning [--ticks 10000000]
    python tests/soak.py work [--hours 24] [--recorded]
    python tests/soak.py link [--seconds 3600]

`learning`: the paper's controller in a loop with a first-order lag, for a number of ticks that would take days with a
tractor. All parameters stay finite and bounded, and memory does not grow. `work`: laps of the figure eight on rough
soil in MuJoCo. Memory is measured from the tenth simulated minute to the end, and while metrics are computed and files
written. `link`: the example host drives over UDP in real time while other work loads the machine. Late ticks, delays of
the schedule and outages of the watchdog are counted.
"""

import argparse
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from math import ceil, inf, pi, radians, sin, tan, tanh
from pathlib import Path
from typing import Any

import numpy as np
from processes import free_ports

from agrobot_mj import load_scenario, run
from agrobot_mj.control.pd_fnn import PdT2fnn
from agrobot_mj.control.t2fnn import T2FnnState
from agrobot_mj.core.kernels import fetched
from agrobot_mj.core.signals import TICK_S
from agrobot_mj.plants.scene import Scene
from agrobot_mj.recording import Recording
from agrobot_mj.scenario.schema import Scenario
from agrobot_mj.simulation.log import Log, Rows
from agrobot_mj.simulation.storage import write_log

HOST = Path(__file__).parents[1] / "examples" / "agopengps_host" / "host.py"
SETTLED_S = 600.0  # Simulated time after which memory must not grow [s]
FLAT_MB = 50.0  # Maximum growth of memory [MB]
BOUND = 100.0  # Upper bound on the magnitude of every parameter of a network [unit of the parameter]
SAMPLE_S = 5.0  # Wall time between two measurements of the memory [s]


def memory_mb(process: int | str = "self", peak: bool = False) -> float:
    """Return the resident memory of a process [MB], or its peak since `forget_peak`, or 0 after the process has
    ended."""
    try:
        text = Path(f"/proc/{process}/status").read_text()
    except OSError:
        return 0.0
    name = "VmHWM" if peak else "VmRSS"
    return next((float(line.split()[1]) / 1e3 for line in text.splitlines() if line.startswith(name)), 0.0)


def forget_peak() -> None:
    """Reset the peak memory of this process to its current memory."""
    Path("/proc/self/clear_refs").write_text("5")


def largest(state: T2FnnState) -> float:
    """Return the maximum magnitude of all parameters of a network, or infinity if a parameter is not finite."""
    numbers = np.concatenate([np.ravel(part) for part in state])
    return float(np.abs(numbers).max()) if np.isfinite(numbers).all() else inf


def learning(ticks: int) -> bool:
    """Let the network learn, and return whether its parameters stay bounded and memory does not grow.

    The yaw rate follows u tan(delta)/L with a lag of 0.3 s, towards a reference that oscillates as on the figure eight,
    with noise of 0.01 rad/s. As on a tractor, the network does not converge with these signals.
    """
    law, chance, yaw_rate, began = PdT2fnn(), np.random.default_rng(1), 0.0, time.monotonic()
    state, early, bound, tenth = law.init(), 0.0, 0.0, max(ticks // 10, 1)
    for first in range(0, ticks, tenth):
        for k, noise in enumerate(chance.normal(0.0, 0.01, min(tenth, ticks - first)).tolist()):
            t = (first + k) * TICK_S
            error = 0.12 * tanh(5 * sin(t * 2 * pi / 120)) - yaw_rate - noise
            state, command = law.update(state, t, error, TICK_S, radians(45))
            yaw_rate += TICK_S / 0.3 * (1.2 / 1.4 * tan(command.steer) - yaw_rate)
        assert state.network is not None
        network = fetched(state.network).state
        bound, early = max(bound, largest(network)), early or memory_mb()
        print(
            f"  {first + tenth:.2g} ticks: q {network.q:.3f}, largest {bound:.3g}, {memory_mb():.0f} MB",
            flush=True,
        )
    grown, seconds = memory_mb() - early, time.monotonic() - began
    print(
        f"learning: {ticks:.0e} ticks in {seconds:.0f} s, no parameter beyond {bound:.3g}, "
        f"memory {grown:+.1f} MB since the first tenth"
    )
    return bound < BOUND and grown < FLAT_MB


class Memory:
    """Observer that records the memory every simulated minute."""

    def __init__(self) -> None:
        self.samples: list[tuple[float, float]] = []

    def start(self, scenario: Scenario, scene: Scene, rows: Rows) -> None:
        self.rows = rows

    def advance(self, first: int) -> None:
        """Record the memory after a part of the run."""
        before, now = first * TICK_S, self.rows.filled * TICK_S
        self.samples.append((now, memory_mb()))
        if before < SETTLED_S <= now:
            forget_peak()
        if now // 3600 > before // 3600:
            print(f"  {now / 3600:.0f} h: {memory_mb():.0f} MB", flush=True)

    def finish(self, log: Log) -> None:
        """Do nothing after the run."""

    def fail(self, error: BaseException) -> None:
        """Do nothing after an error."""


def drive_for(hours: float, recorded: bool) -> bool:
    """Simulate laps for some hours. Return whether memory stops growing after ten minutes, until all files are written.

    After an interrupt, the result covers the simulated hours.
    """
    keys = {"path.turns": ceil(hours * 3600 / 119.0), "duration_s": hours * 3600, "terrain.half_size_m": 60.0}
    rough = {"terrain.kind": "rough", "terrain.grade_deg": 0.0, "plant.tyre.kind": "soil"}
    memory, began, stopped = Memory(), time.monotonic(), list[int]()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda number, frame: stopped.append(number))
    with tempfile.TemporaryDirectory() as folder:
        recording = (Recording(Path(folder) / "run.rrd"),) if recorded else ()
        log = run(load_scenario("figure_eight", {**keys, **rough}), (memory, *recording), lambda: bool(stopped))
        metered = memory_mb(peak=True)
        forget_peak()
        write_log(log, Path(folder), recorded=recorded)
        written = memory_mb(peak=True)
        size = sum(path.stat().st_size for path in Path(folder).iterdir()) / 1e6
    *driven, (_, last) = memory.samples  # at the last sample, the progress along the path has been computed
    later = [mb for t, mb in driven if t >= SETTLED_S] or [last]
    driving, making, writing = (mb - later[0] for mb in (max(later), metered, written))
    print(
        f"work: {log.outcome} after {log.rows.filled * TICK_S / 3600:.2f} h, {log.metrics['real_time_factor']:.0f} x "
        f"real time, lateral rms {log.metrics['lateral_rms']:.4f} m, physics warnings "
        f"{log.metrics['physics_warnings']}, {time.monotonic() - began:.0f} s"
    )
    print(
        f"memory [MB]: {later[0]:.0f} after ten minutes, {driving:+.0f} while driving, {making:+.0f} "
        f"while metrics are made, {writing:+.0f} while files are written ({size:.0f} MB)"
    )
    return log.outcome in ("completed", "aborted") and max(driving, making, writing) < FLAT_MB


def link(seconds: float) -> bool:
    """Run the link in real time. Return whether the host steered throughout and no outage was counted."""
    board, host = free_ports()
    lasting = ["--duration", str(seconds + 120), "--idle", "30"]
    serving = [sys.executable, str(HOST), f"--port={host}", f"--board-port={board}"]
    driving = [sys.executable, "-m", "agrobot_mj", "link", "straight_line", "--set", "guidance.position=paogi"]
    driving += ["--set", "sensors.gnss.dual_antenna.enabled=true", "--set", "terrain.half_size_m=10000"]
    driving += ["--port", str(board), "--host-port", str(host), "--duration", str(seconds), "--start", "engaged"]
    samples = []
    with tempfile.TemporaryDirectory() as folder, subprocess.Popen([*serving, *lasting]) as server:
        try:
            with subprocess.Popen([*driving, "--no-rrd", "--out", folder]) as process:
                while process.poll() is None:
                    samples.append(memory_mb(process.pid))
                    time.sleep(SAMPLE_S)
        finally:
            server.terminate()
        found: dict[str, Any] = json.loads((Path(folder) / "metrics.json").read_text())
    keys = ("turns", "late_turns", "worst_lateness_ms", "slipped_s", "latency_ms_median", "latency_ms_p95")
    keys = (*keys, "latency_ms_worst", "positions", "steer_messages", "outages", "engaged_fraction")
    words = ", ".join(f"{key} {found['link'][key]:.6g}" for key in keys)
    print(
        f"link: {found['outcome']}, status {process.returncode}, {words}, load {os.getloadavg()[2]:.1f}, "
        f"memory {samples[-2:][0]:.0f} MB at the end, {max(samples):.0f} MB at most"
    )
    return process.returncode == 0 and found["link"]["outages"] == 0


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    kinds = parser.add_subparsers(dest="kind", required=True)
    kinds.add_parser("learning").add_argument("--ticks", type=int, default=10_000_000)
    working = kinds.add_parser("work")
    working.add_argument("--hours", type=float, default=24.0)
    working.add_argument("--recorded", action="store_true")
    kinds.add_parser("link").add_argument("--seconds", type=float, default=3600.0)
    given = parser.parse_args()
    if given.kind == "learning":
        return int(not learning(given.ticks))
    return int(not (drive_for(given.hours, given.recorded) if given.kind == "work" else link(given.seconds)))


if __name__ == "__main__":
    raise SystemExit(main())
