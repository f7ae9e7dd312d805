"""Replay: recordings of machines, mapped to SI units, drive a plant, and residuals say how far it is from them."""

from agrobot_mj.fieldlogs.maps import LogMap, read_map
from agrobot_mj.fieldlogs.recording import FieldRecording, read_recording
from agrobot_mj.fieldlogs.replay.command import replay_command

__all__ = ["FieldRecording", "LogMap", "read_map", "read_recording", "replay_command"]
