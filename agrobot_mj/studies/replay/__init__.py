"""Replay: recordings of machines, mapped to SI units, drive a plant, and residuals say how far it is from them."""

from agrobot_mj.studies.replay.command import replay_command
from agrobot_mj.studies.replay.maps import LogMap, read_map
from agrobot_mj.studies.replay.recording import FieldRecording, read_recording

__all__ = ["FieldRecording", "LogMap", "read_map", "read_recording", "replay_command"]
