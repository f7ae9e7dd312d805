"""Yaw controllers: yaw-rate error to steering reference.

Error e = reference - measured yaw rate [rad/s], steering u = tau_c - tau_n [rad], left positive, clipped at
the steering's limit. tau_c = k_P e + k_D de/dt is the conventional controller; tau_n learns beside it from
tau_c (feedback-error learning; paper, section III-B). `pd_t2fnn` is the paper's; the others test plants or
are null models.

Beside its command a controller may report further signals: `columns` names them, `report(state)` has their values.
"""

from math import nan, radians
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from pydantic import Field

from agrobot_mj.control.pid import FilteredRate, clip
from agrobot_mj.control.t2fnn import T1Fnn, T2Fnn, T2FnnState
from agrobot_mj.control.t2fnn_laws import sgn
from agrobot_mj.core.signals import Array, Command
from agrobot_mj.core.spec import NonNegative, Positive, Spec

NOTHING = np.empty(0)


class _Yaw(Spec):
    """What all yaw controllers share."""

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the signals that the controller reports."""
        return ()

    def report(self, state: Any) -> Array:
        """Values of `columns` behind the last command, from the state after it."""
        return NOTHING


class OpenLoop(_Yaw):
    """A steering step, deaf to the yaw rate; for tests of the plant."""

    kind: Literal["open_loop"] = "open_loop"
    steer_deg: Annotated[float, Field(ge=-60, le=60)] = 5.0
    """Angle of the step, left positive [deg]. Estimate."""
    at_s: NonNegative = 1.0
    """When the step comes [s]. Estimate."""

    def init(self) -> None:
        """Nothing to remember."""

    def update(
        self, state: None, t: float, yaw_rate_error: float, dt: float, steer_limit: float
    ) -> tuple[None, Command]:
        """Command at time t [s]."""
        steer = radians(self.steer_deg) if t >= self.at_s else 0.0
        return None, Command(clip(steer, -steer_limit, steer_limit), 0.0, 0.0, nan)


class _Pd(_Yaw):
    """Gains that all closed-loop controllers share."""

    kp: float = 0.4
    """k_P [rad s/rad]. Estimate."""
    kd: float = 0.0
    """k_D [rad s2/rad]. Estimate."""
    derivative_filter_s: NonNegative = 0.2
    """Time constant of the filter of de/dt [s]. Estimate."""

    def _conventional(self, slope: FilteredRate, e: float, dt: float) -> tuple[FilteredRate, float]:
        """The filtered derivative of the error and tau_c [rad]."""
        slope = slope.after(e, dt, self.derivative_filter_s)
        return slope, self.kp * e + self.kd * slope.rate


class PdState(NamedTuple):
    """Memory of `Pd`."""

    slope: FilteredRate = FilteredRate()
    """Of the yaw-rate error [rad/s]."""


class Pd(_Pd):
    """The conventional controller alone."""

    kind: Literal["pd"] = "pd"

    def init(self) -> PdState:
        """At rest."""
        return PdState()

    def update(
        self, state: PdState, t: float, yaw_rate_error: float, dt: float, steer_limit: float
    ) -> tuple[PdState, Command]:
        """Command from the error [rad/s] after dt [s]; `steer_limit` [rad]."""
        slope, tau_c = self._conventional(state.slope, yaw_rate_error, dt)
        return PdState(slope), Command(clip(tau_c, -steer_limit, steer_limit), tau_c, 0.0, nan)


class IntegralState(NamedTuple):
    """Memory of `PdIsgn`."""

    slope: FilteredRate = FilteredRate()
    """Of the yaw-rate error [rad/s]."""
    tau_n: float = 0.0
    """The integral [rad]."""


class PdIsgn(_Pd):
    """PD plus the integral of its own sign: what a network of constant firing does; the one to beat."""

    kind: Literal["pd_isgn"] = "pd_isgn"
    alpha: Positive = 0.02
    """Rate of the integral [rad/s]. Estimate, that of `T2Fnn`."""
    delta_s: Positive = 0.05
    """Smoothing of the sign function [rad]. Paper."""

    def init(self) -> IntegralState:
        """At rest."""
        return IntegralState()

    def update(
        self, state: IntegralState, t: float, yaw_rate_error: float, dt: float, steer_limit: float
    ) -> tuple[IntegralState, Command]:
        """Command from the error [rad/s] after dt [s]; `steer_limit` [rad]."""
        slope, tau_c = self._conventional(state.slope, yaw_rate_error, dt)
        tau_n = state.tau_n
        command = Command(clip(tau_c - tau_n, -steer_limit, steer_limit), tau_c, tau_n, nan)
        return IntegralState(slope, tau_n - self.alpha * sgn(tau_c, self.delta_s) * dt), command


class NeuroState(NamedTuple):
    """Memory of `PdT2fnn` and `PdT1fnn`."""

    slope: FilteredRate = FilteredRate()
    """Of the yaw-rate error [rad/s]."""
    network: T2FnnState | None = None
    """None before the first error, about which the network's sets are laid."""
    asked: T2FnnState | None = None
    """The network as it was when it gave the last tau_n, before it learnt from that tick."""
    saturated: bool = False
    """Whether the last command was clipped."""


class _PdNetwork(_Pd):
    """PD with a network beside it; inputs of the network are the error and its filtered derivative."""

    network: T2Fnn = T2Fnn()
    """The network and its learning laws."""
    anti_windup: bool = False
    """Learning holds while the steering command is clipped; off as in the paper [-]."""

    def init(self) -> NeuroState:
        """At rest."""
        return NeuroState()

    def update(
        self, state: NeuroState, t: float, yaw_rate_error: float, dt: float, steer_limit: float
    ) -> tuple[NeuroState, Command]:
        """Command, with the q behind its tau_n, from the error [rad/s] after dt [s]; `steer_limit` [rad]."""
        e = yaw_rate_error
        slope, tau_c = self._conventional(state.slope, e, dt)
        network = state.network or self.network.init(e, slope.rate)
        learn = not (self.anti_windup and state.saturated)
        learnt, tau_n = self.network.update(network, e, slope.rate, tau_c, dt, learn)
        asked = network._replace(c1=learnt.c1, c2=learnt.c2, x1=learnt.x1, x2=learnt.x2)
        wanted = tau_c - tau_n
        steer = clip(wanted, -steer_limit, steer_limit)
        return NeuroState(slope, learnt, asked, steer != wanted), Command(steer, tau_c, tau_n, network.q)

    @property
    def columns(self) -> tuple[str, ...]:
        """Of the network, see `T2Fnn.columns`."""
        return self.network.columns

    def report(self, state: NeuroState) -> Array:
        """The network behind the last tau_n; NaN before the first."""
        return np.full(len(self.columns), nan) if state.asked is None else self.network.report(state.asked)


class PdT2fnn(_PdNetwork):
    """The paper's controller."""

    kind: Literal["pd_t2fnn"] = "pd_t2fnn"


class PdT1fnn(_PdNetwork):
    """Null model: the same laws with lower and upper bounds that coincide."""

    kind: Literal["pd_t1fnn"] = "pd_t1fnn"
    network: T1Fnn = T1Fnn()
    """The network and its learning laws, of type 1."""
