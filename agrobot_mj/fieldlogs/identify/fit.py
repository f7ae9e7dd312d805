"""Fit of the lateral dynamics to a recording, and the uncertainty of what it finds.

Residuals are those of the yaw rate and of the position, in windows of some seconds: in each the position is laid on the
recording by a shift and a turn, so that the drift of an open loop counts no more than the shape of the way. Both are
whitened by an autoregression of their own residuals (generalised least squares, three rounds), since errors of RTK and
of the recorded inputs are correlated over many samples; the shift and the turn are projected out after that. The
covariance is that of a bootstrap of whole windows, and of noise added to the recorded steering angle.

Stiffnesses are fitted as compliances, 1/C: the understeer gradient is linear in them, and an axle too stiff to be seen
is a compliance whose interval reaches zero.
"""

from collections.abc import Sequence
from math import inf, radians, sqrt
from typing import NamedTuple

import numpy as np
from scipy.interpolate import Akima1DInterpolator
from scipy.optimize import OptimizeResult, least_squares
from scipy.signal import butter, sosfiltfilt

from agrobot_mj.core.randomness import stream
from agrobot_mj.core.signals import Array
from agrobot_mj.fieldlogs.identify.model import STEP_S, Chassis2, Lateral, LateralMotion, simulate, wheel_angle
from agrobot_mj.fieldlogs.recording import FieldRecording, TimeSeries
from agrobot_mj.fieldlogs.replay.residuals import moving, rigid

WINDOW_S = 5.0
"""Length of a window [s]: longer than the dynamics, and many in a minute."""
ORDER = 8
"""Order of the autoregression of residuals [-]."""
ROUNDS = 3
"""Rounds of whitening and fitting [-]: the numbers stand still after two."""
CUT_OFF_HZ = 3.0
"""Cut-off of the low-pass over the inputs [Hz]. Noise above it would pass for slowness of the tractor."""
PLAY_CUT_OFF_HZ = 8.0
"""Cut-off before the play [Hz], so that the jumps of a sensor that turns round before the wheels stay sharp."""
SETTLE_S = 2.0
"""Time at the start that is left out, until start and play are forgotten [s]."""
DRAWS = 12
"""Draws of noise of the recorded angle [-]."""
LEAST_SAMPLES = 30
"""Least number of samples of a channel in a window."""


class Parameter(NamedTuple):
    """A quantity of the fit."""

    start: float
    low: float
    high: float
    scale: float
    """Typical size."""


PARAMETERS = {
    "front_compliance": Parameter(5e-5, 0.0, 2e-3, 1e-5),
    "rear_compliance": Parameter(3e-5, 0.0, 2e-3, 1e-5),
    "front_relaxation_m": Parameter(0.3, 0.0, 5.0, 0.1),
    "rear_relaxation_m": Parameter(0.5, 0.0, 5.0, 0.1),
    "steer_offset": Parameter(0.0, -0.3, 0.3, 0.01),
    "steer_delay_s": Parameter(0.02, -0.5, 1.0, 0.02),
    "steer_lag_s": Parameter(0.05, 0.0, 1.0, 0.02),
    "backlash": Parameter(radians(0.2), 0.0, radians(20.0), 0.01),
    "gyro_offset": Parameter(0.0, -0.2, 0.2, 0.01),
    "speed_error": Parameter(0.0, -0.3, 0.3, 0.01),
}
"""Everything that can be fitted; compliances in rad/N for a tractor of 750 kg, scaled by mass. SI and radians."""
NUISANCE = ("gyro_offset", "speed_error")
"""Fitted along where the recording can tell, and not reported as the vehicle's."""


class WindowedChannel(NamedTuple):
    """A measured quantity in windows."""

    t: Array
    """Times, shape (windows, n) [s]."""
    value: Array
    """Values, shape (windows, n), or (windows, n, 2) for positions."""


class VehicleData(NamedTuple):
    """A recording, prepared for the fit."""

    recording: FieldRecording
    chassis: Chassis2
    t: Array
    """Times of the model's steps [s]."""
    steer: Array
    """Recorded wheel angle at them, without what is faster than `CUT_OFF_HZ` [rad]."""
    u: Array
    """Recorded speed at them, alike [m/s]."""
    channels: dict[str, WindowedChannel]
    """`yaw_rate` and `position`, those that there are."""
    steer_noise: float
    """White noise of the recorded angle [rad]."""


class Autoregression(NamedTuple):
    """Model of a channel's residuals."""

    coefficients: Array
    """Coefficients for the last p values, shape (p,)."""
    sigma: float
    """Standard deviation of what drives it."""


class VehicleFit(NamedTuple):
    """Result of a fit."""

    names: tuple[str, ...]
    value: Array
    """Values of `names`, SI and radians."""
    covariance: Array
    """Their covariance."""
    freedom: int
    """Degrees of freedom of the intervals: windows less one."""

    @property
    def values(self) -> dict[str, float]:
        """Values by name."""
        return dict(zip(self.names, self.value.tolist(), strict=True))


def prepare(recording: FieldRecording, chassis: Chassis2) -> VehicleData:
    """Windows of a recording that has a wheel angle, and a yaw rate from a gyro or heading, or positions."""
    t = np.arange(recording.start, recording.end, STEP_S)
    measured = {"yaw_rate": recording.yaw_rate, "position": recording.position}
    if recording.yaw_rate_source == "course":  # the positions once more, smoothed
        measured["yaw_rate"] = None
    windows = {name: _windows(recording, series) for name, series in measured.items() if series is not None}
    common = set.intersection(*map(set, windows.values())) if windows else set()
    channels = {
        name: WindowedChannel(*(np.array(each) for each in zip(*(found[k] for k in sorted(common)), strict=True)))
        for name, found in windows.items()
        if common
    }
    speed = _smoothed(recording.speed.at(t), CUT_OFF_HZ)
    steer = _smoothed(recording.steer.at(t), PLAY_CUT_OFF_HZ) if recording.steer else np.zeros(len(t))
    return VehicleData(recording, chassis, t, steer, speed, channels, _white_noise(recording.steer))


def _smoothed(values: Array, cut_off: float) -> Array:
    """Values at the model's steps without what is faster than `cut_off` [Hz], in phase."""
    smooth: Array = sosfiltfilt(butter(4, cut_off * 2 * STEP_S, output="sos"), values)
    return smooth


def _white_noise(recorded: TimeSeries | None) -> float:
    """Noise of the recorded angle, from third differences, blind to slow steering; by the median, deaf to jumps."""
    if recorded is None or len(recorded.t) < 4:
        return 0.0
    off = np.abs(np.diff(recorded.value, 3))
    return 1.4826 * float(np.median(off)) / sqrt(20.0)  # of a normal distribution; 1 + 9 + 9 + 1 variances


def _windows(recording: FieldRecording, series: TimeSeries) -> dict[int, TimeSeries]:
    """Complete windows by their number, of equally many samples, at speed all the time."""
    start, end = recording.start + SETTLE_S, recording.end
    inside = series.between(start, end)
    spacing = float(np.median(np.diff(inside.t))) if len(inside.t) > 1 else inf
    n = int(WINDOW_S / spacing)
    fast, found = moving(recording, inside), {}
    for k in range(int((end - start) / WINDOW_S)):
        part = fast.between(start + k * WINDOW_S, start + (k + 1) * WINDOW_S)
        if n >= LEAST_SAMPLES and len(part.t) >= n - 1 and np.diff(part.t).max() < 2.5 * spacing:
            found[k] = TimeSeries(part.t[: n - 1], part.value[: n - 1])
    return found


def motion(p: dict[str, float], data: VehicleData) -> LateralMotion:
    """Motion of the model with parameters `p`."""
    recorded = Akima1DInterpolator(data.t, data.steer, extrapolate=True)(data.t - p.get("steer_delay_s", 0.0)) - p.get(
        "steer_offset", 0.0
    )
    delta = wheel_angle(recorded, STEP_S, p.get("backlash", 0.0), p.get("steer_lag_s", 0.0))
    delta = _smoothed(delta, CUT_OFF_HZ)
    stiff = 1e-9
    C_f, C_r = (1.0 / max(p[f"{axle}_compliance"], stiff) for axle in ("front", "rear"))
    tyres = Lateral(C_f, C_r, p.get("front_relaxation_m", 0.0), p.get("rear_relaxation_m", 0.0))
    return simulate(data.chassis, tyres, data.u * (1.0 + p.get("speed_error", 0.0)), delta, STEP_S)


def predictions(p: dict[str, float], data: VehicleData) -> dict[str, Array]:
    """What the channels would say, positions laid on the recorded ones in each window."""
    m, found = motion(p, data), {}
    if channel := data.channels.get("yaw_rate"):
        found["yaw_rate"] = np.interp(channel.t, data.t, m.yaw_rate) + p.get("gyro_offset", 0.0)
    if channel := data.channels.get("position"):
        ahead, left, _ = data.recording.arm
        x = m.rear_x + ahead * np.cos(m.yaw) - left * np.sin(m.yaw)
        y = m.rear_y + ahead * np.sin(m.yaw) + left * np.cos(m.yaw)
        points = np.stack([np.interp(channel.t, data.t, x), np.interp(channel.t, data.t, y)], axis=2)
        found["position"] = np.stack([rigid(a, b).of(a) for a, b in zip(points, channel.value, strict=True)])
    return found


def whitened(series: Array, noise: Autoregression) -> Array:
    """Series (windows, n, ...) without its autoregression, over its sigma; the first p samples go."""
    a, p = noise.coefficients, len(noise.coefficients)
    n = series.shape[1]
    white = series[:, p:].copy()
    for k in range(p):
        white -= a[k] * series[:, p - 1 - k : n - 1 - k]
    scaled: Array = white / noise.sigma
    return scaled


def noise_of(residuals: Array) -> Autoregression:
    """Autoregression of residuals (windows, n, ...), by least squares over all windows."""
    if residuals.ndim == 3:
        residuals = np.concatenate([residuals[..., 0], residuals[..., 1]])
    n = residuals.shape[1]
    past = np.stack([residuals[:, ORDER - 1 - k : n - 1 - k].ravel() for k in range(ORDER)], axis=1)
    now = residuals[:, ORDER:].ravel()
    coefficients = np.linalg.lstsq(past, now, rcond=None)[0].astype(np.float64)
    return Autoregression(coefficients, max(float(np.std(now - past @ coefficients)), 1e-12))


class Problem:
    """Least-squares problem under a model of the noise."""

    def __init__(self, data: VehicleData, names: Sequence[str], noise: dict[str, Autoregression]) -> None:
        self.data, self.names, self.noise = data, tuple(names), noise
        self.bases = [self._basis(window) for window in data.channels["position"].value] if "position" in noise else []

    def _basis(self, window: Array) -> Array:
        """Orthonormal whitened columns of a shift and a turn of a window's positions (n, 2)."""
        centred, one, zero = window - window.mean(axis=0), np.ones(len(window)), np.zeros(len(window))
        motions = [(one, zero), (zero, one), (-centred[:, 1], centred[:, 0])]
        columns = [whitened(np.stack(pair, axis=1)[None], self.noise["position"]).ravel() for pair in motions]
        return np.linalg.qr(np.stack(columns, axis=1))[0]

    def blocks(self, x: Array) -> Array:
        """Whitened residuals by window, shape (windows, samples); positions without what a shift and a turn explain."""
        p = dict(zip(self.names, x.tolist(), strict=True))
        parts = []
        for name, model in predictions(p, self.data).items():
            white = whitened(model - self.data.channels[name].value, self.noise[name])
            flat = white.reshape(len(white), -1)
            if name == "position":
                flat = np.stack([r - q @ (q.T @ r) for r, q in zip(flat, self.bases, strict=True)])
            parts.append(flat)
        return np.concatenate(parts, axis=1)


def fit(data: VehicleData, names: Sequence[str]) -> VehicleFit:
    """Fit the parameters `names` of `PARAMETERS`, three rounds of whitening."""
    names = (*names, *(n for n in NUISANCE if _seen(n, data)))
    ratio = 750.0 / data.chassis.mass
    specs = [PARAMETERS[n] for n in names]
    factor = np.array([ratio if "compliance" in n else 1.0 for n in names])
    low, high = (factor * np.array([getattr(s, key) for s in specs]) for key in ("low", "high"))
    scale, x = factor * np.array([s.scale for s in specs]), factor * np.array([s.start for s in specs])
    noise = {k: Autoregression(np.zeros(ORDER), 0.01) for k in data.channels}
    result: OptimizeResult | None = None
    for _ in range(ROUNDS):
        problem = Problem(data, names, noise)
        # in units of the typical sizes, since the solver's tolerance is on the norm of all parameters together
        result = least_squares(
            lambda z, problem=problem: problem.blocks(z * scale).ravel(),
            np.clip(x, low + 1e-3 * scale, high) / scale,
            bounds=(low / scale, high / scale),
            diff_step=1e-3,
            xtol=1e-6,
            ftol=1e-9,
            max_nfev=60,
        )
        x = result.x * scale
        p = dict(zip(names, x.tolist(), strict=True))
        noise = {k: noise_of(m - data.channels[k].value) for k, m in predictions(p, data).items()}
    problem = Problem(data, names, noise)
    J, r = _jacobian(problem, x, scale, low, high), problem.blocks(x)
    # what the recording does not show keeps a huge variance
    information = np.einsum("wnp,wnq->pq", J, J) + 1e-9 * np.eye(len(x))
    shift, scatter = _noisy_input(problem, x, scale, low, high, information)
    covariance = (_bootstrap(J, r, information) + scatter) * np.outer(scale, scale)
    if "backlash" in names:  # play no wider than the noise cannot be told from it
        covariance[names.index("backlash"), names.index("backlash")] += data.steer_noise**2
    x = np.clip(x - shift * scale, low, high)
    return VehicleFit(names, x, covariance, len(next(iter(data.channels.values())).t) - 1)


def _jacobian(problem: Problem, x: Array, scale: Array, low: Array, high: Array) -> Array:
    """Change of the blocks with each parameter in units of its scale, shape (windows, samples, parameters)."""
    columns = []
    for k, step in enumerate(0.05 * scale):
        up, down = x.copy(), x.copy()
        up[k], down[k] = min(x[k] + step, high[k]), max(x[k] - step, low[k])
        columns.append((problem.blocks(up) - problem.blocks(down)) * (scale[k] / (up[k] - down[k])))
    return np.stack(columns, axis=2)


def _bootstrap(J: Array, r: Array, information: Array) -> Array:
    """Covariance of the parameters by a bootstrap of blocks in closed form.

    The residuals of whole windows, all channels together, are drawn again for each window, with replacement, so that
    what the autoregression misses and what channels share counts. A window's residuals are those of a fit without it:
    few windows leave little that their own fit has not taken. With g = sum of J_w' r_v over the windows w, each with a
    window v of its own, Var g = sum over w of the mean over v of (J_w' r_v)(J_w' r_v)'.
    """
    left_out = np.stack([e + j @ np.linalg.solve(information - j.T @ j, j.T @ e) for j, e in zip(J, r, strict=True)])
    g = np.einsum("wnp,vn->wvp", J, left_out)
    inverse = np.linalg.inv(information)
    covariance: Array = inverse @ (np.einsum("wvp,wvq->pq", g, g) / len(r)) @ inverse
    return covariance


def _noisy_input(
    problem: Problem, x: Array, scale: Array, low: Array, high: Array, information: Array
) -> tuple[Array, Array]:
    """Shift of the parameters by the noise of the recorded angle, and their scatter, in units of `scale`.

    As much noise again is added, and one step of the fit taken from there: what it does is what the noise that is there
    has done already, to first order [Cook1994]. Noise passes for slowness of the tractor, and play takes it away.
    """
    data, steps = problem.data, []
    assert data.recording.steer is not None
    t = data.recording.steer.t
    for k in range(DRAWS):
        noise = data.steer_noise * stream(k, "identify.steer").standard_normal(len(t))
        added = _smoothed(np.interp(data.t, t, noise), PLAY_CUT_OFF_HZ)
        noisy = Problem(data._replace(steer=data.steer + added), problem.names, problem.noise)
        J, r = _jacobian(noisy, x, scale, low, high), noisy.blocks(x)
        steps.append(-np.linalg.solve(information, np.einsum("wnp,wn->p", J, r)))
    return np.mean(steps, axis=0), np.cov(np.array(steps).T)


def _seen(nuisance: str, data: VehicleData) -> bool:
    return "yaw_rate" in data.channels if nuisance == "gyro_offset" else "position" in data.channels
