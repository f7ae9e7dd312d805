"""Turns of equal length on the wall clock."""

import time


class Pace:
    """Turns of equal length on the wall clock, and how well they were kept; the first one begins the schedule."""

    LATE_S = 0.005
    """A turn that begins later than this is late [s]."""

    def __init__(self, period: float) -> None:
        self.period, self.turns, self.late, self.worst, self.slipped = period, 0, 0, 0.0, 0.0
        self.next = time.perf_counter()

    def begin(self) -> float:
        """A turn begins now; returns by how much too late [s].

        More than a whole turn behind, the schedule moves: catching up would send positions faster than hosts take them.
        """
        now = time.perf_counter()
        behind = now - self.next if self.turns else 0.0
        self.next = self.next if self.turns else now  # what was compiled or loaded before it made no turn late
        self.turns += 1
        self.late += behind > self.LATE_S
        self.worst = max(self.worst, behind)
        if behind > self.period:
            self.next += behind
            self.slipped += behind
        self.next += self.period
        return behind
