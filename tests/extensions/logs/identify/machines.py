"""Machines with hidden parameters, and logs of these machines with the noise of real sensors.

`log_of` runs the simulator's bicycle, which has no relaxation. `tyred_log` integrates a separate bicycle model with
relaxation by a solver of SciPy. `mistold` changes the steering angles in the log.
"""

from functools import cache
from math import pi, radians

import numpy as np
import pyarrow as pa
from scipy.integrate import solve_ivp

from agrobot_mj import Simulation

MASS, INERTIA, L_F, L_R = 750.0, 400.0, 0.868, 0.532
"""Mass, yaw inertia and axle distances of the default tractor [kg, kg m2, m, m]."""
TICK_S = 0.05


def excitation(seed):
    """Return steering [rad] and speed [m/s] as functions of time: eight sines of 0.08 to 0.5 Hz, and 1.4 to 3.8 m/s."""
    rng = np.random.default_rng(seed)
    frequencies, phases = rng.uniform(0.08, 0.5, 8), rng.uniform(0, 2 * pi, 8)

    def steer(t):
        return radians(1.5) * sum(np.sin(2 * pi * f * t + p) for f, p in zip(frequencies, phases, strict=True))

    return steer, lambda t: 2.6 + 1.2 * np.sin(2 * pi * t / 23)


@cache
def log_of(seed, duration=60.0, **keys):
    """Return the signals of the simulator's bicycle with other stiffnesses, steered by the excitation."""
    given = {
        "plant.kind": "bicycle",
        "sensors.gyro.enabled": True,
        "path.speed_m_s": 2.6,
        "duration_s": duration,
        "seed": seed,
        **{key.replace("__", "."): value for key, value in keys.items()},
    }
    sim = Simulation("straight_line", given)
    sim.reset()
    steer, speed = excitation(seed)
    while not sim.done:
        t = sim.truth.t
        sim.step(steer=float(steer(t)), speed=float(speed(t)))
    return sim.log()


def behind_play(steer, backlash, delay, duration):
    """Return the wheel angle as a function of time, after a steering play `backlash` [rad] and a delay [s]."""
    t = np.arange(-1.0, duration, 1e-3)
    followed = steer(t)
    for k in range(1, len(t)):
        followed[k] = min(max(followed[k - 1], followed[k] - backlash / 2), followed[k] + backlash / 2)
    return lambda now: np.interp(now - delay, t, followed)


def tyred_log(seed, C_f, C_r, sigma_f, sigma_r, backlash=0.0, offset=0.0, delay=0.0, duration=60.0, noise_deg=0.06):
    """Return signals of a bicycle with linear tyres, relaxation lengths of both axles [m], and small angles.

    The steering sensor is before the play [rad]. Its measurement has an offset [rad] and leads the wheel angle [s].
    """
    steer, speed = excitation(seed)
    wheel = behind_play(steer, backlash, delay, duration)

    def rate(t, s):
        x, y, psi, v, r, a_f, a_r = s
        u, d = speed(t), wheel(t)
        Y_f, Y_r = -C_f * a_f, -C_r * a_r
        return [
            u * np.cos(psi) - (v - L_R * r) * np.sin(psi),
            u * np.sin(psi) + (v - L_R * r) * np.cos(psi),
            r,
            (Y_f + Y_r) / MASS - u * r,
            (L_F * Y_f - L_R * Y_r) / INERTIA,
            (v + L_F * r - u * d - u * a_f) / sigma_f,
            (v - L_R * r - u * a_r) / sigma_r,
        ]

    t = TICK_S * np.arange(round(duration / TICK_S))
    # the simulator's logs start at rest; this log starts off its steady state, which the fit omits
    s = solve_ivp(rate, (0.0, duration), np.zeros(7), t_eval=t, rtol=1e-6, atol=1e-8, max_step=0.05).y
    rng = np.random.default_rng([seed, 7])
    n = len(t)
    within = TICK_S * ((np.arange(10) + 0.5) / 10 - 1)
    mean = np.mean([steer(t + w) for w in within], axis=0)
    slow = np.zeros((n, 2))
    for k in range(1, n):  # correlated over 30 s, as for RTK
        slow[k] = slow[k - 1] * np.exp(-TICK_S / 30) + 0.01 * np.sqrt(
            1 - np.exp(-2 * TICK_S / 30)
        ) * rng.standard_normal(2)
    fixes = s[:2].T + slow + 0.017 * rng.standard_normal((n, 2))
    return pa.table(
        {
            "t": t,
            "steer_measured": mean + offset + radians(noise_deg) * rng.standard_normal(n),
            "valve_voltage": np.full(n, 6.0),
            "speed_hat": speed(t) + 0.01 * rng.standard_normal(n),
            "gyro": s[4] + radians(0.02) + radians(0.1) * rng.standard_normal(n),
            "gnss_x": fixes[:, 0],
            "gnss_y": fixes[:, 1],
            "gnss_quality": np.full(n, 2.0),
        }
    )


def mistold(table, backlash=0.0, offset=0.0, delay=0.0):
    """Return a copy of the log with the angle of a steering sensor before a play [rad], with an offset [rad] and a lead
    to the wheels [s]."""
    t, true = (np.asarray(table[name]) for name in ("t", "steer"))
    direction = np.sign(np.gradient(np.convolve(true, np.ones(3) / 3, "same"), t))
    told = np.asarray(table["steer_measured"]) + 0.5 * backlash * direction + offset
    at = table.column_names.index("steer_measured")
    return table.set_column(at, "steer_measured", pa.array(np.interp(t + delay, t, told)))
