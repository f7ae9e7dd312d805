"""Test doubles for the link: a host in another process, and a kinematic plant."""

import subprocess
import sys
from contextlib import contextmanager
from math import cos, radians, sin, tan

import host
import numpy as np

from agrobot_mj.core.geometry import wrap
from agrobot_mj.core.signals import TICK_S, Fix, Measurement, Quality, Truth


@contextmanager
def host_process(port, board_port, *arguments):
    """Run the test host in a separate process during the `with` block."""
    command = [sys.executable, host.__file__, f"--port={port}", f"--board-port={board_port}", "--duration=60"]
    process = subprocess.Popen([*command, *arguments], stderr=subprocess.PIPE, text=True)
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


class Toy:
    """Kinematic tractor without steering lag or noise, simulated for `duration` [s]."""

    WHEELBASE = 1.4

    def __init__(self, duration, y=1.0, speed=1.5):
        self.duration, self.start, self.speed = duration, y, speed
        self.track, self.actuations = [], []
        self.reset()

    def reset(self):
        self.t, self.x, self.y, self.yaw, self.angle = 0.0, 0.0, self.start, 0.0, 0.0
        return self._measure()

    @property
    def done(self):
        return self.t >= self.duration

    def drive(self, actuation):
        self.actuations.append(actuation)
        if actuation.voltage is None:
            self.angle = actuation.steer
        else:
            self.angle += radians(10) * (actuation.voltage - 6.0) * TICK_S
        self.yaw = wrap(self.yaw + self.speed * tan(self.angle) / self.WHEELBASE * TICK_S)
        self.x += self.speed * cos(self.yaw) * TICK_S
        self.y += self.speed * sin(self.yaw) * TICK_S
        self.t += TICK_S
        self.track.append((self.t, self.x, self.y))
        return self._measure()

    def _measure(self):
        v = self.speed * cos(self.yaw), self.speed * sin(self.yaw)
        return Measurement(
            self.t, Fix(self.x, self.y, *v, self.t, 2.0, self.yaw), Quality.FIX, self.angle, 0.0, 0.0, 0.0, 0.0
        )

    @property
    def truth(self):
        v = self.speed * cos(self.yaw), self.speed * sin(self.yaw), 0.0
        return Truth(
            *(self.t, self.x, self.y, 0.0, self.yaw, 0.0, 0.0, self.speed, 0.0, 0.0, self.angle, 0.0),
            *(self.x, self.y, (self.x, self.y, 2.0), v, np.zeros(1), np.zeros(1)),
        )
