"""The riding tractor's twin: the machine of that name, with the motor, the receivers and the sensor of its logs.

The motor stands in the place of the steering valve: 12 V is full drive to the left, 6 V none. Its dead band, rate and
lag come from the runs of the calibration.
"""

from typing import Any, NamedTuple

import numpy as np

from agrobot_mj import load_scenario
from agrobot_mj.core.signals import NEUTRAL_V, Array
from agrobot_mj.machine.hydraulics import LITRE_PER_MINUTE
from agrobot_mj.scenario import Scenario
from riding_tractor.firmware import MOST
from riding_tractor.logs import CALIBRATION, FieldLog, Repository, field_log

MACHINE = "riding"
ROW_S = 0.05
"""Time between rows of the board [s]."""
FREE = (215.0, 790.0)
"""Readings between which the wheels are off their stops [counts]."""
SETTLED = 2
"""Rows with the same direction of drive after which the rate is that of the drive."""
LAG_S = 0.03
"""Lag of the motor [s]. Estimate: its rate has settled within two rows."""
RECEIVERS: dict[str, Any] = {
    "sensors.gnss.sigma_m": 0.008,
    "sensors.gnss.latency_s": 0.2,
    "sensors.gnss.dual_antenna.enabled": True,
    "sensors.steering_pot.samples": 1,
    "sensors.steering_pot.savgol_window": 1,
    "sensors.steering_pot.savgol_polyorder": 0,
}
"""Receivers and sensor: the scatter of fixes at rest, less that of writing them; the age of a heading, 0.23 s by the
calibration; a board that reads its sensor once."""


class Motor(NamedTuple):
    """Steering motor."""

    dead_band: float
    """Drive at which it begins to turn [counts of 255]."""
    rate: float
    """Steering rate per drive beyond that [deg/s per count]."""

    def at(self, drive: float) -> float:
        """Steering rate at a drive [deg/s]."""
        return self.rate * max(drive - self.dead_band, 0.0)

    @property
    def valve(self) -> dict[str, Any]:
        """Keys of the valve that stands for it, beside a cylinder of the default size."""
        volts = NEUTRAL_V / MOST
        cylinder = load_scenario("straight_line").steering.cylinder
        flow = np.radians(self.rate / volts) * cylinder.displacement / LITRE_PER_MINUTE
        keys = {
            "delay_s": 0.0,
            "time_constant_s": LAG_S,
            "dead_band_v": self.dead_band * volts,
            "gain_left_l_min_v": float(flow),
            "gain_right_l_min_v": float(flow),
            "pump_flow_l_min": float(flow * NEUTRAL_V),
        }
        return {f"steering.valve.{key}": value for key, value in keys.items()}


def motor(repository: Repository, degrees_per_count: float) -> Motor:
    """The motor in the runs of the calibration."""
    steps = [_rates(field_log(repository, run)) for run in CALIBRATION]
    drive, rate = (np.concatenate(each) for each in zip(*steps, strict=True))
    slope, level = np.polyfit(drive, rate, 1)
    return Motor(float(-level / slope), float(slope * degrees_per_count))


def _rates(log: FieldLog) -> tuple[Array, Array]:
    """Drive and rate of the potentiometer along it [counts, counts/s], where the drive has kept its direction."""
    way = np.sign(log.pwm)
    kept = np.ones(len(way) - 1 - SETTLED, dtype=bool)
    for k in range(1, SETTLED + 1):
        kept &= way[SETTLED:-1] == way[SETTLED - k : -1 - k]
    kept &= (way[SETTLED:-1] != 0) & (log.pot[SETTLED:-1] > FREE[0]) & (log.pot[SETTLED:-1] < FREE[1])
    rate = way[SETTLED:-1] * np.diff(log.pot)[SETTLED:] / ROW_S
    return np.abs(log.pwm[SETTLED:-1])[kept], rate[kept]


def twin(found: Motor) -> Scenario:
    """The twin on a straight line."""
    return load_scenario("straight_line", {"machine": MACHINE, **found.valve, **RECEIVERS})
