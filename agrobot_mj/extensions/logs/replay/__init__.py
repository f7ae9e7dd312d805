"""Replay: recordings of machines, mapped to SI units, drive a plant, and residuals say how far it is from them."""

from agrobot_mj.extensions.logs.replay.result import files_of_replay, replay, write_replay
from agrobot_mj.extensions.logs.replay.words import summary

__all__ = ["files_of_replay", "replay", "summary", "write_replay"]
