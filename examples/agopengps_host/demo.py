"""Closed-loop runs with the small guidance host over UDP: level ground, side slope, noise, and valve control.

The program prints the table of the page link.md. Each row is a run of 80 s at 1.5 m/s, which starts at a lateral offset
of 1 m from the line of the host. With the first word of a row as argument, such as `slope`, only rows with this first
word are simulated.
"""

import socket
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from agrobot_mj import load_scenario
from agrobot_mj.core.markdown import markdown_table
from agrobot_mj.extensions.links.agopengps.link import link
from agrobot_mj.extensions.links.agopengps.session import LinkOptions
from agrobot_mj.simulation.progress import tally

HOST = Path(__file__).with_name("host.py")
LEVEL, SLOPE = "straight_line", "side_slope_10"
TWO_ANTENNAS = {"guidance.position": "paogi", "sensors.gnss.dual_antenna.enabled": True}
NOISELESS = {
    **{"sensors.gnss.sigma_m": 0.0, "sensors.gnss.velocity_sigma_m_s": 0.0},
    **{"sensors.gnss.dual_antenna.sigma_m": 0.0, "sensors.gnss.dual_antenna.wander_sigma_m": 0.0},
    **{"sensors.steering_pot.noise_sigma_deg": 0.01, "sensors.steering_pot.resolution_deg": 0.01},
}
TOY = {
    **{**NOISELESS, "plant.kind": "bicycle", "steering.valve.delay_s": 0.0, "steering.valve.time_constant_s": 0.001},
    **{"steering.valve.dead_band_v": 0.0, "steering.loop.deadband_compensation_v": 0.0},
}
UNIT = {"sensors.imu.enabled": True, "sensors.gyro.enabled": True}
PWM = {**TWO_ANTENNAS, "guidance.steer_by": "pwm"}
ROWS = {
    "toy: bicycle, fast valve without dead band, no noise": (LEVEL, {**TWO_ANTENNAS, **TOY}, ""),
    "level: two antennas": (LEVEL, TWO_ANTENNAS, ""),
    "stanley: two antennas": (LEVEL, TWO_ANTENNAS, "--law stanley"),
    "unit: one antenna, inertial unit": (LEVEL, UNIT, ""),
    "single: one antenna alone": (LEVEL, {}, ""),
    "single: one antenna alone, look-ahead 4 s": (LEVEL, {}, "--look-ahead 4"),
    "board: its own law, settings as shipped": (LEVEL, PWM, ""),
    "board: its own law, tuned to this valve": (LEVEL, PWM, "--board 40 255 17"),
    "slope: 10 deg, no roll": (SLOPE, TWO_ANTENNAS, ""),
    "slope: 10 deg, roll": (SLOPE, {**TWO_ANTENNAS, **UNIT}, ""),
    "slope: 10 deg, roll, side hill 0.2": (SLOPE, {**TWO_ANTENNAS, **UNIT}, "--side-hill 0.2"),
    "slope: 10 deg, roll, integral": (SLOPE, {**TWO_ANTENNAS, **UNIT}, "--integral 0.02"),
}
"""Scenario, overrides, and command-line arguments of the host for each table row, by name of the row."""


def free_ports() -> tuple[int, int]:
    """Return the numbers of two free UDP ports."""
    with socket.socket(type=socket.SOCK_DGRAM) as a, socket.socket(type=socket.SOCK_DGRAM) as b:
        for each in (a, b):
            each.bind(("127.0.0.1", 0))
        return a.getsockname()[1], b.getsockname()[1]


def row(name: str, scenario: str, overrides: dict[str, object], host: str, folder: Path) -> tuple[str, ...]:
    """Simulate the run of one table row, and return the cells of the row."""
    own, other = free_ports()
    keys = {"guidance.kind": "agopengps", "path.start_offset_m": 1.0, "path.speed_m_s": 1.5, "duration_s": 80.0}
    command = [sys.executable, str(HOST), f"--port={other}", f"--board-port={own}", *host.split()]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    try:
        arguments = LinkOptions(port=own, host_port=other, pace="answered")
        log = link(load_scenario(scenario, {**keys, **overrides}), folder, arguments, (), lambda: bool(process.poll()))
    finally:
        process.kill()
        said = process.communicate()[1]
        if process.returncode > 0:
            print(said, file=sys.stderr)
    t, off = log.column("t"), log.column("rear_y") * 100
    far = np.flatnonzero(np.abs(off) >= 5)
    settled = f"{t[far[-1] + 1]:.0f}" if len(far) and far[-1] + 1 < len(t) else "never"
    late = off[t > t[-1] - 40]
    rms, mean = np.sqrt(np.mean(late**2)), np.mean(late)
    return name, f"`{host or '-'}`", f"{max(-off.min(), 0):.0f}", settled, f"{rms:.1f}", f"{mean:+.1f}"


def main() -> None:
    """Simulate the selected runs and print the table."""
    heads = ("run", "host", "overshoot [cm]", "below 5 cm after [s]", "rms of the last 40 s [cm]", "mean [cm]")
    some = {name: parts for name, parts in ROWS.items() if len(sys.argv) < 2 or name.split(":")[0] == sys.argv[1]}
    with tempfile.TemporaryDirectory() as folder, tally(f"{len(some)} runs", len(some)) as advance:
        rows = []
        for name, parts in some.items():
            rows.append(row(name, *parts, Path(folder)))
            advance()
    print(markdown_table(heads, rows))


if __name__ == "__main__":
    main()
