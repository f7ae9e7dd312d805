"""Calibration of the sensors of a log: what the map says of steering, heading and position, found from driving."""

from agrobot_mj.extensions.logs.calibrate.calibration import Calibration, calibrate
from agrobot_mj.extensions.logs.calibrate.words import FILES, map_lines, report, sentences, write_calibration

__all__ = ["FILES", "Calibration", "calibrate", "map_lines", "report", "sentences", "write_calibration"]
