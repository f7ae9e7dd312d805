"""Wall-clock schedule of the cycles in which a link exchanges messages with an external program."""

import time


class Pace:
    """Wall-clock schedule of the cycles of a link, with timing statistics. The schedule starts at the first cycle."""

    LATE_S = 0.005
    """Delay above which a cycle counts as late [s]."""

    def __init__(self, period: float) -> None:
        self.period, self.turns, self.late, self.worst, self.slipped = period, 0, 0, 0.0, 0.0
        self.next = time.perf_counter()

    def begin(self) -> float:
        """Begin a cycle. Return its delay relative to the schedule [s].

        A delay longer than a cycle shifts the schedule, because hosts cannot process positions in quick succession.
        """
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
