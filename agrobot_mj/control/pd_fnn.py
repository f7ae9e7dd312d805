"""Controller of the paper: PD in parallel with a fuzzy neural network that learns from the PD output.

The steering angle is u = tau_c - tau_n [rad]. The network output tau_n is trained on the PD output tau_c
(feedback-error learning; paper, section III-B). The inputs are the yaw-rate error [rad/s] and its derivative [rad/s2].
"""

from collections.abc import Sequence
from math import nan
from typing import ClassVar, Literal, NamedTuple, cast

from agrobot_mj.control.base import YawCommand
from agrobot_mj.control.pd import Conventional, PdGains, conventional
from agrobot_mj.control.pid import FilteredRate, clip
from agrobot_mj.control.t2fnn import T1Fnn, T2Fnn
from agrobot_mj.control.t2fnn_laws import Network, tick
from agrobot_mj.core.calls import Linked, address_of, caller_of
from agrobot_mj.core.held import Held
from agrobot_mj.core.kernels import fetched, held, stage
from agrobot_mj.core.signals import Array, Column, Vector


class NeuroState(NamedTuple):
    """State of `PdT2fnn` and `PdT1fnn` between two ticks."""

    slope: FilteredRate = FilteredRate()  # Filtered derivative of the yaw-rate error [rad/s2]
    network: Held[Network] | None = None  # Network, initialised at the first error, or None before the first error
    reported: Array | None = None
    """Log values of the network in the last tick, taken before the learning step, or None before the first tick."""
    saturated: bool = False  # Whether the last command was clipped at the steering limit


class NetworkLaw(NamedTuple):
    """Parameters of a `PdNetwork` as numbers for compiled kernels, and the address of `t2fnn_laws.tick`."""

    gains: PdGains
    anti_windup: bool
    learn: int


class NetworkNumbers(NamedTuple):
    """State of a `PdNetwork` after its first tick; `NeuroState` describes the fields."""

    slope: FilteredRate
    network: Held[Network]
    saturated: bool


_learn = caller_of(tick)


@stage
def _tick(
    law: Held[NetworkLaw], state: Held[NetworkNumbers], e: float, ahead: float, steer: float, dt: float, limit: float
) -> tuple[Held[NetworkNumbers], YawCommand, Vector]:
    """Return the new state, the command, and the log values of the network; see `base.controller_form`."""
    p, s = fetched(law), fetched(state)
    slope, tau_c = conventional(p.gains, s.slope, e, dt)
    learns = not (p.anti_windup and s.saturated)
    done, (network, tau_n, q, shown) = _learn(p.learn, (s.network, e, slope.rate, tau_c, dt, learns))
    wanted = tau_c - tau_n if done else nan
    limited = clip(wanted, -limit, limit) if done else nan
    return held(NetworkNumbers(slope, network, limited != wanted)), YawCommand(limited, tau_c, tau_n, q), shown


class PdNetwork(Conventional):
    """Base class of the controllers with a PD part and, in parallel, a network with the same inputs."""

    network: T2Fnn = T2Fnn()
    """Fuzzy neural network and its learning laws."""
    anti_windup: bool = False
    """Whether learning stops while the steering command is limited. Default: false, as in the paper."""
    tunable: ClassVar = {**Conventional.tunable, "network.alpha": (0.005, 0.5)}
    """Search ranges for tuning the gains."""

    def init(self) -> NeuroState:
        """Return the initial state; the network is created in the first update."""
        return NeuroState()

    def update(
        self, state: NeuroState, t: float, yaw_rate_error: float, dt: float, steer_limit: float
    ) -> tuple[NeuroState, YawCommand]:
        """Return the new state after training for `dt` [s], and the steering command for a yaw-rate error [rad/s]."""
        if state.network is None:
            slope, _ = self.conventional(state.slope, yaw_rate_error, dt)
            state = state._replace(network=self.network.start(yaw_rate_error, slope.rate))
        law, now = self._numbers(state)
        found, command, shown = _tick(law, now, yaw_rate_error, 0.0, nan, dt, steer_limit)
        return self.state_after_ticks(state, found, shown), command

    def _numbers(self, state: NeuroState) -> tuple[Held[NetworkLaw], Held[NetworkNumbers]]:
        law = NetworkLaw(self.gains, self.anti_windup, address_of(tick, tick))
        return held(law), held(NetworkNumbers(state.slope, cast(Network, state.network), state.saturated))

    @property
    def interpreted(self) -> bool:
        """Whether ticks in compiled code must call the Python method `update`: true for further subclasses."""
        return type(self) not in (PdT2fnn, PdT1fnn)

    def compiled_tick(self, state: NeuroState) -> Linked | None:
        """Return the compiled tick function, its parameters and its state, or None before the first tick."""
        return Linked(_tick, *self._numbers(state)) if state.network is not None else None

    def state_after_ticks(self, state: NeuroState, found: Held[NetworkNumbers], shown: Vector) -> NeuroState:
        """Return the state after ticks in compiled code, which ended in the state `found`."""
        now = fetched(found)
        return NeuroState(now.slope, now.network, shown, now.saturated)

    @property
    def columns(self) -> tuple[Column, ...]:
        """Log columns of the network; see `T2Fnn.columns`."""
        return self.network.columns

    def report(self, state: NeuroState) -> Sequence[float]:
        """Return the log values of the last tick, taken before the learning step, or NaN before the first tick."""
        return [nan] * len(self.columns) if state.reported is None else state.reported.tolist()


class PdT2fnn(PdNetwork):
    """Controller of the paper: PD controller in parallel with a type-2 fuzzy neural network."""

    kind: Literal["pd_t2fnn"] = "pd_t2fnn"
    label: ClassVar = "PD + T2FNN"


class PdT1fnn(PdNetwork):
    """Baseline with a type-1 network: the learning laws of `PdT2fnn`, with equal lower and upper fuzzy sets."""

    kind: Literal["pd_t1fnn"] = "pd_t1fnn"
    label: ClassVar = "PD + T1FNN"
    network: T1Fnn = T1Fnn()
    """Type-1 fuzzy neural network and its learning laws."""
