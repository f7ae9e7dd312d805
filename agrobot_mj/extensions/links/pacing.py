"""Schedule of turns of equal length on the wall clock."""

import time


class Pace:
    """Schedule of turns of equal duration on the wall clock, starting at the first turn, with timing statistics."""

    LATE_S = 0.005
    """Delay above which a turn is late [s]."""

    def __init__(self, period: float) -> None:
        self.period, self.turns, self.late, self.worst, self.slipped = period, 0, 0, 0.0, 0.0
        self.next = time.perf_counter()

    def begin(self) -> float:
        """Begin a turn now. Return its delay relative to the schedule [s]. A delay above the duration of a turn shifts
        the schedule, because hosts cannot process positions in quick succession."""
        now = time.perf_counter()
        behind = now - self.next if self.turns else 0.0
        self.next = self.next if self.turns else now  # compilation and loading before the first turn are no delay
        self.turns += 1
        self.late += behind > self.LATE_S
        self.worst = max(self.worst, behind)
        if behind > self.period:
            self.next += behind
            self.slipped += behind
        self.next += self.period
        return behind
