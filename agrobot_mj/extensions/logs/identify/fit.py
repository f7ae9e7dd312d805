"""Fit of the lateral dynamics and of the sensors to recordings, with the uncertainty of the estimates.

Residuals of gyro yaw rate, heading and position are computed in windows of several seconds. Predictions are aligned
with the recording in each window, because otherwise the drift of an open-loop simulation would dominate
(`predictions`). Errors of RTK positions and of recorded inputs are correlated over many samples. Therefore all
residuals are whitened by an autoregression (generalised least squares, three rounds). The components due to shifts and
rotations of windows are then removed. The covariance comes from a bootstrap of complete windows and from noise added to
the recorded steering angle and speed.

Stiffnesses C are fitted as compliances 1/C, because the understeer gradient is linear in compliances. The interval of a
stiff axle that is not identifiable includes zero compliance. Quantities that might not be identifiable have a normal
prior, which acts as an additional measurement in the fit and in the covariance.
"""

from collections.abc import Iterator, Mapping, Sequence
from functools import lru_cache
from itertools import product
from math import radians
from typing import NamedTuple

import numpy as np
from scipy.optimize import OptimizeResult, least_squares

from agrobot_mj.core.randomness import stream
from agrobot_mj.core.signals import Array
from agrobot_mj.extensions.logs.identify.model import LateralMotion
from agrobot_mj.extensions.logs.identify.predictions import MASS_KG, PARAMETERS, dynamics_of, motion, predictions
from agrobot_mj.extensions.logs.identify.windows import SPEED_CUT_OFF_HZ, WINDOW_S, FitPiece, VehicleData, low_pass
from agrobot_mj.machine.tractor import GRAVITY, TractorParameters

MEMORY_S = 0.4
"""Time span of the autoregressive model of residuals [s]. The model order is limited to `LEAST_ORDER` to
`MOST_ORDER`."""
LEAST_ORDER, MOST_ORDER = 2, 8
SHORT = 12
"""Maximum number of evaluations of a second fit in the last round. This fit starts at the initial values and detects
whether the first rounds, with their preliminary noise models, have led to a worse local minimum."""
ROUNDS = 3  # Number of rounds of whitening and fitting. Two rounds suffice for convergence.
SLOW_S = 60.0
"""Maximum time difference between windows whose errors may be correlated [s], limited to a third of the log."""
PAIRS = 6  # Number of noise realisations that are added to, and subtracted from, the recorded wheel angle and speed
NUISANCE = ("gyro_offset", "heading_offset", "speed_error")
"""Sensor errors that are fitted if identifiable but are not reported."""


class Prior(NamedTuple):
    """Normal prior distribution of a fitted quantity."""

    mean: float
    sigma: float  # Standard deviation of the prior


class Autoregression(NamedTuple):
    """Autoregressive model of the residuals in one channel."""

    coefficients: Array  # Coefficients of the last p residuals, the most recent first, shape (p,)
    sigma: float  # Standard deviation of the innovations


class VehicleFit(NamedTuple):
    """Fitted vehicle and sensor parameters with their covariance."""

    names: tuple[str, ...]
    value: Array  # Fitted values of the parameters `names` [SI, rad]
    covariance: Array
    freedom: Array  # Degrees of freedom of the variances, for Student t intervals

    @property
    def errors(self) -> dict[str, float]:
        """Standard errors of the fitted parameters by name."""
        return dict(zip(self.names, np.sqrt(np.diag(self.covariance)).tolist(), strict=True))

    @property
    def values(self) -> dict[str, float]:
        """Values of the fitted parameters by name."""
        return dict(zip(self.names, self.value.tolist(), strict=True))


def whiten(series: Array, noise: Autoregression) -> Array:
    """Return the innovations of `series` (windows, n, ...) under an autoregressive model, divided by their standard
    deviation. The first p samples are omitted, where p is the model order."""
    a, p = noise.coefficients, len(noise.coefficients)
    n = series.shape[1]
    white = series[:, p:].copy()
    for k in range(p):
        white -= a[k] * series[:, p - 1 - k : n - 1 - k]
    scaled: Array = white / noise.sigma
    return scaled


def noise_of(residuals: Array, spacing: float) -> Autoregression:
    """Fit an autoregressive model of time span `MEMORY_S` to residuals (windows, n, ...) at a `spacing` [s]."""
    if residuals.ndim == 3:
        residuals = np.concatenate([residuals[..., 0], residuals[..., 1]])
    order, n = int(np.clip(round(MEMORY_S / spacing), LEAST_ORDER, MOST_ORDER)), residuals.shape[1]
    past = np.stack([residuals[:, order - 1 - k : n - 1 - k].ravel() for k in range(order)], axis=1)
    now = residuals[:, order:].ravel()
    coefficients = np.linalg.lstsq(past, now, rcond=None)[0].astype(np.float64)
    return Autoregression(coefficients, max(float(np.std(now - past @ coefficients)), 1e-12))


class Problem:
    """Nonlinear least-squares problem of a vehicle fit, with a noise model for each measured channel."""

    def __init__(self, data: VehicleData, names: Sequence[str], noise: Mapping[str, Autoregression]) -> None:
        self.data, self.names, self.noise = data, tuple(names), noise
        dynamics = dynamics_of(data)
        self.dynamic = [k for k, name in enumerate(self.names) if name in dynamics]
        # the Jacobian reuses a motion for all sensor parameters
        self.motions = lru_cache(maxsize=2)(self._motions)
        self.bases = {name: self._basis(name, list(found)) for name, found in self._freedoms()}

    def _motions(self, dynamics: tuple[float, ...]) -> list[LateralMotion]:
        p = dict(zip((self.names[k] for k in self.dynamic), dynamics, strict=True))
        return [motion(p, self.data, piece) for piece in self.data.pieces]

    def _freedoms(self) -> Iterator[tuple[str, list[Array]]]:
        """Yield the name of each channel whose initial value is free in every window, and the derivatives of the
        channel with respect to these initial values."""
        if heading := self.data.channels.get("heading"):
            yield "heading", [np.ones_like(heading.value)]
        if position := self.data.channels.get("position"):
            x, y = np.moveaxis(position.value - position.value.mean(axis=1, keepdims=True), 2, 0)
            one, zero = np.ones_like(x), np.zeros_like(x)
            free = [(one, zero), (zero, one)] if heading else [(one, zero), (zero, one), (-y, x)]
            yield "position", [np.stack(pair, axis=2) for pair in free]

    def _basis(self, name: str, columns: list[Array]) -> Array:
        """Return an orthonormal basis of the whitened `columns` of a channel, shape (windows, samples, columns)."""
        white = [whiten(column, self.noise[name]).reshape(len(column), -1) for column in columns]
        return np.linalg.qr(np.stack(white, axis=2))[0]

    def blocks(self, x: Array) -> Array:
        """Return the whitened residuals (windows, samples) for parameters `x`, without the components that free initial
        values of the windows can explain."""
        p = dict(zip(self.names, x.tolist(), strict=True))
        model, parts = predictions(p, self.data, self.motions(tuple(x[self.dynamic].tolist()))), []
        for name, channel in self.data.channels.items():
            r = whiten(model[name] - channel.value, self.noise[name]).reshape(len(channel.t), -1, 1)
            if (q := self.bases.get(name)) is not None:
                r = r - q @ (q.transpose(0, 2, 1) @ r)
            parts.append(r[..., 0])
        return np.concatenate(parts, axis=1)


class _Units(NamedTuple):
    """Bounds, initial values, scales and priors of the n fitted parameters. Each array has shape (n,)."""

    low: Array
    high: Array
    start: Array
    scale: Array
    mean: Array  # Means of the priors
    weight: Array
    """Scale of each parameter divided by the standard deviation of its prior, or 0 if there is no prior."""

    def known(self, x: Array) -> Array:
        """Return the differences between `x` and the prior means, divided by the prior standard deviations."""
        off: Array = self.weight * (x - self.mean) / self.scale
        return off


def _units(names: Sequence[str], mass: float, priors: Mapping[str, Prior]) -> _Units:
    factor = np.array([MASS_KG / mass if "compliance" in name else 1.0 for name in names])
    low, high, start, scale = (
        factor * np.array([getattr(PARAMETERS[name], key) for name in names])
        for key in ("low", "high", "start", "scale")
    )
    mean = np.array([priors[name].mean if name in priors else 0.0 for name in names])
    weight = np.array([s / priors[name].sigma if name in priors else 0.0 for name, s in zip(names, scale, strict=True)])
    start = np.where(weight > 0, mean, start)
    return _Units(low, high, start, scale, mean, weight)


def fit(data: VehicleData, names: Sequence[str], priors: Mapping[str, Prior] | None = None) -> VehicleFit:
    """Fit vehicle and sensor parameters to recordings in three rounds of fitting and whitening. `names` are keys of
    `PARAMETERS`. `priors` contains normal priors by parameter name."""
    names = tuple(dict.fromkeys((*names, *(n for n in NUISANCE if _is_identified(n, data)))))
    units = _units(names, data.chassis.mass, priors or {})
    scale, x = units.scale, units.start
    noise = {k: Autoregression(np.zeros(LEAST_ORDER), 0.01) for k in data.channels}
    for last in (*[False] * (ROUNDS - 1), True):
        problem = Problem(data, names, noise)
        result = _minimum(problem, units, x, 1e-9 if last else 1e-5)
        if last and (other := _minimum(problem, units, units.start, 1e-5, SHORT)).cost < result.cost:
            result = _minimum(problem, units, other.x * scale, 1e-9)
        x = result.x * scale
        found = predictions(dict(zip(names, x.tolist(), strict=True)), data)
        noise = {k: noise_of(found[k] - channel.value, channel.spacing) for k, channel in data.channels.items()}
    problem = Problem(data, names, noise)
    J, r = _jacobian(problem, x, units), problem.blocks(x)
    # parameters without information keep a very large variance
    information = np.einsum("wnp,wnq->pq", J, J) + np.diag(units.weight**2 + 1e-9)
    shift, scatter = _noisy_input(problem, x, units, information)
    covariance, freedom = _bootstrap(J, r, information, units.weight**2)
    covariance = (covariance + scatter) * np.outer(scale, scale)
    # a parameter at its bound does not follow small noise, so that the estimated bias is uncertain
    at_bound = np.minimum(x - units.low, units.high - x) < 1e-2 * scale
    covariance += np.diag(np.where(at_bound, shift * scale, 0.0) ** 2)
    if "backlash" in names:  # noise hides a play of the same size
        covariance[names.index("backlash"), names.index("backlash")] += data.steer_noise**2
    x = np.clip(x - shift * scale, units.low, units.high)
    return VehicleFit(names, x, covariance, freedom)


def _minimum(problem: Problem, units: _Units, start: Array, ftol: float, evaluations: int = 60) -> OptimizeResult:
    """Minimise the squared residuals, starting from `start`. The result contains scaled parameters. The parameters are
    scaled, because the tolerance of the solver applies to their norm."""
    scale = units.scale
    return least_squares(
        lambda z: np.concatenate([problem.blocks(z * scale).ravel(), units.known(z * scale)]),
        np.clip(start, units.low + 1e-3 * scale, units.high) / scale,
        bounds=(units.low / scale, units.high / scale),
        diff_step=1e-3,
        xtol=1e-6,
        ftol=ftol,
        max_nfev=evaluations,
    )


def _jacobian(problem: Problem, x: Array, units: _Units) -> Array:
    """Return the derivatives of `Problem.blocks` with respect to the scaled parameters, shape (windows, samples,
    parameters)."""
    columns = []
    for k, step in enumerate(0.05 * units.scale):
        up, down = x.copy(), x.copy()
        up[k], down[k] = min(x[k] + step, units.high[k]), max(x[k] - step, units.low[k])
        columns.append((problem.blocks(up) - problem.blocks(down)) * (units.scale[k] / (up[k] - down[k])))
    return np.stack(columns, axis=2)


def _bootstrap(J: Array, r: Array, information: Array, known: Array) -> tuple[Array, Array]:
    """Return the covariance of the scaled parameters by a block bootstrap in closed form, and the degrees of freedom of
    the variances.

    The bootstrap resamples the residuals of complete windows, with all channels together. The covariance thus includes
    correlations that the autoregression misses, and correlations between channels. A fit to few windows underestimates
    its own residuals. Therefore the residuals of each window are multiplied by (1 - H)^-1/2, where H is the leverage of
    the window [MacKinnonWhite1985]. Let J_w be the Jacobian of window w, and r_v the residuals of a random window v.
    The variance of sum_w J_w' r_v is sum_w mean_v (J_w' r_v)(J_w' r_v)'. The inverse variances `known` of the priors
    are added. If neighbouring windows are correlated (slow errors of two antennas), variances are increased by the
    autocorrelations up to `SLOW_S`, with Bartlett's window [NeweyWest1987]. The degrees of freedom follow from the
    spread of the variances between the random windows v [Satterthwaite1946]. They are at most the number of windows
    minus 1, because the residuals within a window are not independent.
    """
    inverse = np.linalg.inv(information)
    A = J @ np.linalg.cholesky(inverse)  # H = A A'
    leverage, axes = np.linalg.eigh(np.einsum("wnp,wnq->wpq", A, A))
    leverage = np.clip(leverage, 1e-9, 1 - 1e-9)
    grown = np.einsum("wpq,wq,wrq,wnr,wn->wp", axes, ((1 - leverage) ** -0.5 - 1) / leverage, axes, A, r, optimize=True)
    g = np.einsum("wnp,vn->wvp", J, r + np.einsum("wnp,wp->wn", A, grown)) @ inverse
    covariance = np.einsum("wvp,wvq->pq", g, g) / len(r) + inverse @ np.diag(known) @ inverse
    each = (g**2).sum(axis=0)
    spread = np.maximum(each.var(axis=0, ddof=1), 1e-300)
    freedom = np.clip(2 * len(r) * each.mean(axis=0) ** 2 / spread, 1.0, len(r) - 1)
    said = np.einsum("wwp->wp", g)
    most = min(int(SLOW_S / WINDOW_S), len(r) // 3)
    alike = [(1 - k / (most + 1)) * (said[k:] * said[:-k]).sum(axis=0) for k in range(1, most + 1)]
    growth = np.sqrt(np.maximum(1.0, 1.0 + 2.0 * np.sum(alike, axis=0) / np.maximum((said**2).sum(axis=0), 1e-300)))
    correlated: Array = covariance * np.outer(growth, growth)
    return correlated, freedom


def _noisy_input(problem: Problem, x: Array, units: _Units, information: Array) -> tuple[Array, Array]:
    """Return the bias and covariance of the scaled parameters due to noise in the recorded inputs.

    Noise with the estimated standard deviation is added to the inputs, and one step of the fit follows. To first order,
    the resulting parameter change equals the effect of the noise already present [Cook1994]. Each realisation is also
    subtracted, so that the effects linear in the noise cancel in the mean. Effects in different windows are
    independent, so that their covariances add.
    """
    data, steps, clean = problem.data, [], _gradient(problem, x, units)
    for k, sign in product(range(PAIRS), (1.0, -1.0)):
        randoms = stream(k, "identify.steer"), stream(k, "identify.speed")
        pieces = tuple(_with_noise(piece, data, sign, *randoms) for piece in data.pieces)
        noisy = Problem(data._replace(pieces=pieces), problem.names, problem.noise)
        steps.append(np.linalg.solve(information, (clean - _gradient(noisy, x, units)).T).T)
    added, subtracted = np.array(steps[::2]), np.array(steps[1::2])
    odd, even = (added - subtracted) / 2, (added + subtracted) / 2
    bias = even.mean(axis=0)
    parts = np.sqrt(1 / PAIRS) * odd, np.sqrt(1 / (PAIRS - 1)) * (even - bias)
    covariance: Array = np.sum([np.einsum("kwp,kwq->pq", each, each) for each in parts], axis=0)
    return bias.sum(axis=0), covariance


def _gradient(problem: Problem, x: Array, units: _Units) -> Array:
    """Return the gradient of half the squared residuals of each window with respect to the scaled parameters, shape
    (windows, parameters)."""
    r, found = problem.blocks(x), []
    for k, step in enumerate(0.05 * units.scale):
        moved = x.copy()
        moved[k] = x[k] + step if x[k] + step <= units.high[k] else x[k] - step
        found.append(((problem.blocks(moved) - r) * r).sum(axis=1) * units.scale[k] / (moved[k] - x[k]))
    return np.stack(found, axis=1)


def _with_noise(
    piece: FitPiece, data: VehicleData, sign: float, of_steer: np.random.Generator, of_speed: np.random.Generator
) -> FitPiece:
    assert piece.recording.steer is not None
    inputs = (
        (piece.recording.steer.t, data.steer_noise, of_steer),
        (piece.recording.speed.t, data.speed_noise, of_speed),
    )
    steer, u = (np.interp(piece.t, t, sign * sigma * random.standard_normal(len(t))) for t, sigma, random in inputs)
    steer, u = low_pass(steer, data.play_cut_off_hz), low_pass(u, SPEED_CUT_OFF_HZ)
    return piece._replace(steer=piece.steer + steer, u=piece.u + u)


def _is_identified(nuisance: str, data: VehicleData) -> bool:
    """Return whether the measured channels identify a parameter of `NUISANCE`."""
    needs = {"gyro_offset": {"yaw_rate"}, "speed_error": {"position"}, "heading_offset": {"heading", "position"}}
    return needs[nuisance] <= set(data.channels)


SLIP_AT_LOAD = Prior(0.1, 0.08)
"""Prior of the slip angle at which the lateral force of a linear tyre equals its load [rad]. The inverse is the
stiffness divided by the load: 5-25 1/rad on roads and 2-10 1/rad on soil."""
RELAXATION = Prior(1.0, 1.0)
"""Prior of the relaxation length divided by the wheel radius [-]: from 0.25 (turf at low speed) to 3 (literature)."""
BACKLASH = Prior(0.0, radians(1.5))  # Prior of the steering play [rad]
SPEED_ERROR = Prior(0.0, 0.02)  # Prior of the relative error of the speed [-]
DELAY_S = 0.3  # Prior standard deviation of a latency [s]
PLACE_M = 0.5  # Prior standard deviation of the antenna position relative to its position in the column map [m]
LEAN_S2 = Prior(0.02, 0.03)
"""Prior of the outward antenna shift due to roll, divided by the lateral acceleration [s2]. The ratio is 0 with tilt
correction, 0.014 for the compact tractor and 0.045 for a narrow tractor."""
CENTRE, SCALE = Prior(0.0, radians(5.0)), Prior(1.0, 0.2)
"""Priors of steering centre [rad] and steering scale [-], relative to the result of a regression without slip."""


def priors(tractor: TractorParameters, age: float) -> dict[str, Prior]:
    """Return the priors by parameter name. `age` is the latency of the yaw rate relative to the steering [s]."""
    weight, front = tractor.mass_kg * GRAVITY, tractor.front_load_fraction
    found = {
        f"{axle}_compliance": Prior(SLIP_AT_LOAD.mean / load, SLIP_AT_LOAD.sigma / load)
        for axle, load in (("front", weight * front), ("rear", weight * (1 - front)))
    }
    for axle, radius in (("front", tractor.front_wheel_radius_m), ("rear", tractor.rear_wheel_radius_m)):
        found[f"{axle}_relaxation_m"] = Prior(radius * RELAXATION.mean, radius * RELAXATION.sigma)
    found |= {name: Prior(age, DELAY_S) for name in ("heading_delay_s", "position_delay_s")}
    found |= {name: Prior(0.0, PLACE_M) for name in ("ahead_m", "left_m")}
    return found | {
        "backlash": BACKLASH,
        "lean_s2": LEAN_S2,
        "speed_error": SPEED_ERROR,
        "speed_delay_s": Prior(0.0, DELAY_S),
        "steer_offset": CENTRE,
        "steer_scale": SCALE,
        "steer_delay_s": Prior(0.0, DELAY_S),
    }
