"""Fault script of a run, and detection of contradictory faults."""

from collections.abc import Sequence
from typing import Any, NamedTuple

from agrobot_mj.core.contracts import check_update
from agrobot_mj.core.randomness import stream
from agrobot_mj.core.signals import NOMINAL, Conditions, PointMass
from agrobot_mj.faults.base import Scripted
from agrobot_mj.faults.machine import Payload

ScriptState = tuple[Any, ...]


class Script(NamedTuple):
    """Faults of a scenario; `update` applies the active faults once per tick."""

    faults: Sequence[Scripted]  # Faults in the order of the scenario file, which is the order of their application
    seed: int

    def init(self) -> ScriptState:
        """Return the initial states of all faults. Each fault has a separate random stream."""
        return tuple(fault.init(stream(self.seed, f"fault.{fault.subject}.{fault.start_s}")) for fault in self.faults)

    def update(self, state: ScriptState, t: float, dt: float) -> tuple[ScriptState, Conditions]:
        """Return the new fault states and the conditions of the tick from `t` to `t` + `dt` [s]. Call once per tick."""
        states, found = list(state), NOMINAL
        for k, fault in enumerate(self.faults):
            if fault.active(t):
                answer = fault.apply(states[k], found, t, dt)
                states[k], found = check_update(answer, Conditions, f"fault[{k}]", fault.kind, "apply")
        return tuple(states), found

    def active(self, t: float) -> int:
        """Return the number of faults that are active at the time `t` [s]."""
        return sum(fault.active(t) for fault in self.faults)


def clashes(faults: Sequence[Scripted]) -> list[str]:
    """Return messages about overlapping faults with the same subject; each starts with the key of the later fault."""
    found = []
    earlier: dict[str, list[int]] = {}
    for k, fault in enumerate(faults):
        alike = earlier.setdefault(fault.subject, [])
        if (first := next((i for i in alike if fault.overlaps(faults[i])), None)) is not None:
            found.append(
                f"fault[{k}]: this {fault.kind} fault ({_window(fault)}) overlaps fault[{first}] "
                f"({_window(faults[first])}); end one before the start of the other"
            )
        alike.append(k)
    return found


def loadings(faults: Sequence[Scripted]) -> list[tuple[int, tuple[PointMass, ...]]]:
    """Return, for each start and end of a payload fault, the fault's index and the point masses active at this time."""
    found = []
    for k, fault in enumerate(faults):
        if isinstance(fault, Payload):
            times = (fault.start_s,) if fault.end_s is None else (fault.start_s, fault.end_s)
            found += [(k, tuple(f.load for f in faults if isinstance(f, Payload) and f.active(t))) for t in times]
    return found


def _window(fault: Scripted) -> str:
    return f"{fault.start_s:g} to {'the end' if fault.end_s is None else f'{fault.end_s:g} s'}"
