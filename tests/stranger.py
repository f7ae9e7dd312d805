"""Machine of an unknown user with hidden parameters, and the log recorded by its owner.

The machine is an independent bicycle model: stretched-string tyres on both axles (deflection q' = -w - |V| q / sigma,
force C q / sigma), exact angles, and play between steering sensor and wheels. The log has counts for angles, an
unsigned speed, and positions and headings that are delayed, repeated by a faster logger, and quantised. The machine
stops, reverses and loses its position. The log has frozen values and missing seconds.
"""

from math import cos, pi, radians, sin
from typing import NamedTuple

import numpy as np

MASS, INERTIA, L_F, L_R = 750.0, 400.0, 0.868, 0.532
"""Known mass, yaw inertia and axle distances of the default tractor [kg, kg m2, m, m]."""
ROW_S, STEP_S = 0.05, 0.01
ORIGIN = 51.0, 4.0
NORTH_M, EAST_M = 111_248.3, 70_197.7
"""Length of a degree of latitude and of longitude at the origin by the series of WGS 84 [m]."""
END_S = 300.0


class Hidden(NamedTuple):
    """Hidden parameters of the machine, which a fit must identify, in the units of the result of the fit."""

    centre: float
    scale: float  # Wheel angle per count [deg], negative if counts increase to the right
    heading_age: float
    heading_off: float  # Offset of the compass heading [deg]
    position_age: float
    speed_age: float
    ahead: float
    left: float
    C_f: float
    C_r: float
    sigma_f: float
    sigma_r: float
    play: float  # Play of the steering [deg]


def hidden(seed):
    rng = np.random.default_rng([seed, 23])
    return Hidden(
        centre=rng.uniform(380, 520),
        scale=rng.choice([-1, 1]) * rng.uniform(0.08, 0.2),
        heading_age=rng.uniform(0.05, 0.3),
        heading_off=rng.uniform(-2, 2),
        position_age=rng.uniform(0.0, 0.2),
        speed_age=rng.uniform(0.0, 0.2),
        ahead=rng.uniform(-0.3, 0.6),
        left=rng.uniform(-0.3, 0.3),
        C_f=rng.uniform(10e3, 20e3),
        C_r=rng.uniform(20e3, 40e3),
        sigma_f=rng.uniform(0.15, 0.5),
        sigma_r=rng.uniform(0.2, 0.8),
        play=rng.uniform(0.3, 1.5),
    )


def inputs(seed, t):
    """Return speed [m/s] and angle of the steering sensor [rad] at times (n,)."""
    rng = np.random.default_rng([seed, 24])
    corners = [(0, 0), (4, 0), (8, 1.6), (70, 1.6), (76, 3.6), (120, 3.0), (140, 3.8), (146, 0), (151, 0), (153, -1.0)]
    corners += [(168, -1.0), (170, 0), (173, 0), (178, 2.2), (210, 1.2), (230, 3.4), (292, 3.7), (297, 0), (300, 0)]
    speed = np.interp(t, *np.array(corners, dtype=float).T)
    moving = np.abs(speed) > 0
    speed = speed + moving * np.minimum(np.abs(speed), 0.25) * np.sin(2 * pi * t / 17 + rng.uniform(0, 2 * pi))
    f, phase = rng.uniform(0.05, 0.45, 8), rng.uniform(0, 2 * pi, 8)
    swings = np.sin(2 * pi * np.outer(t, f) + phase).sum(axis=1) / 2
    size = np.interp(np.abs(speed), [0, 1.5, 3.8], [9, 8, 3])
    return speed, np.radians(size * swings)


def behind_play(angle, play):
    followed = angle.copy()
    for k in range(1, len(angle)):
        followed[k] = min(max(followed[k - 1], angle[k] - play / 2), angle[k] + play / 2)
    return followed


def drive(h, u, d):
    """Return east, north, heading and yaw rate at every step, computed by the Runge-Kutta method from speed `u` and
    wheel angle `d` at half steps."""
    k_f, k_r = h.C_f / h.sigma_f, h.C_r / h.sigma_r

    def rate(s, u, d):
        _, _, psi, v, r, q_f, q_r = s
        c, s_ = cos(d), sin(d)
        across, side = v + L_F * r, v - L_R * r
        F_f, F_r = k_f * q_f, k_r * q_r
        leak = max(0.0, 0.3 - abs(u))  # without leakage, the springs of a tyre at rest would oscillate without end
        return (
            u * cos(psi) - side * sin(psi),
            u * sin(psi) + side * cos(psi),
            r,
            (F_f * c + F_r) / MASS - u * r,
            (L_F * F_f * c - L_R * F_r) / INERTIA,
            u * s_ - across * c - abs(u * c + across * s_) * q_f / h.sigma_f - leak * q_f,
            -side - abs(u) * q_r / h.sigma_r - leak * q_r,
        )

    state, rows = (0.0,) * 7, []
    for k in range(0, len(u) - 2, 2):
        rows.append((*state[:3], state[4]))
        a = rate(state, u[k], d[k])
        b = rate([x + STEP_S / 2 * y for x, y in zip(state, a, strict=True)], u[k + 1], d[k + 1])
        e = rate([x + STEP_S / 2 * y for x, y in zip(state, b, strict=True)], u[k + 1], d[k + 1])
        g = rate([x + STEP_S * y for x, y in zip(state, e, strict=True)], u[k + 2], d[k + 2])
        slopes = zip(state, a, b, e, g, strict=True)
        state = tuple(x + STEP_S / 6 * (p + 2 * q + 2 * r + w) for x, p, q, r, w in slopes)
    return np.array(rows).T


def slow(rng, n, sigma, seconds, step):
    """Return `n` values of noise with the standard deviation `sigma`, correlated over `seconds` [s]."""
    keep, found = np.exp(-step / seconds), np.zeros(n)
    for k in range(1, n):
        found[k] = keep * found[k - 1] + sigma * np.sqrt(1 - keep * keep) * rng.standard_normal()
    return found


def write_log(seed, file, h=None):
    """Simulate the machine of a seed and write its log. Return the hidden values. Their latencies include the delay
    until the next row of the log."""
    h = h or hidden(seed)
    rng = np.random.default_rng([seed, 25])
    fine = np.arange(0, END_S + STEP_S, STEP_S / 2)
    speed, sensor = inputs(seed, fine)
    x, y, psi, _ = drive(h, speed, behind_play(sensor, radians(h.play)))
    steps = STEP_S * np.arange(len(x))
    t = np.arange(1.0, steps[-1] - ROW_S, ROW_S)
    t = t + rng.uniform(0, 0.004, len(t))
    counts = np.rint(h.centre + np.degrees(np.interp(t, fine, sensor)) / h.scale + 0.5 * rng.standard_normal(len(t)))
    told = np.abs(np.interp(t - h.speed_age, fine, speed) + 0.01 * rng.standard_normal(len(t)))

    fix_t = np.arange(0.5, t[-1], 0.1)
    at = fix_t - h.position_age
    angle = np.interp(at, steps, psi)
    east = np.interp(at, steps, x) + h.ahead * np.cos(angle) - h.left * np.sin(angle)
    north = np.interp(at, steps, y) + h.ahead * np.sin(angle) + h.left * np.cos(angle)
    east, north = (p + 0.006 * rng.standard_normal(len(p)) + slow(rng, len(p), 0.008, 30, 0.1) for p in (east, north))
    latitude = np.round(ORIGIN[0] + north / NORTH_M, 8)
    longitude = np.round(ORIGIN[1] + east / EAST_M, 8)

    head_t = np.arange(0.52, t[-1], 0.2)
    heading = 90 - np.degrees(np.interp(head_t - h.heading_age, steps, psi)) + h.heading_off
    heading += 0.1 * rng.standard_normal(len(head_t)) + slow(rng, len(head_t), 0.1, 60, 0.2)

    last_fix, last_head = (np.searchsorted(each, t, side="right") - 1 for each in (fix_t, head_t))
    frozen = (t > 100) & (t < 108)
    last_fix[frozen] = last_fix[frozen][0]
    rows = ["ms;pot;v;lat;lon;fix;course;ok"]
    for k in range(len(t)):
        if 60 < t[k] < 63.5 or 240 < t[k] < 242:
            continue
        i, j = last_fix[k], last_head[k]
        fix = "float" if 200 < t[k] < 205 else "fixed"
        rows.append(
            f"{1000 * t[k]:.0f};{counts[k]:.0f};{3.6 * told[k]:.3f};{latitude[i]:.8f};{longitude[i]:.8f};{fix};"
            f"{heading[j] % 360:.3f};{'true' if not 30 < t[k] < 33 else 'false'}"
        )
    file.write_text("\n".join(rows) + "\n")
    waited = [np.mean(t[np.searchsorted(t, each[each > t[0]])] - each[each > t[0]]) for each in (fix_t, head_t)]
    return h._replace(position_age=h.position_age + waited[0], heading_age=h.heading_age + waited[1])


MAP = """
title = "stranger"
[time]
column = "ms"
unit = "ms"
[steer]
column = "pot"
[speed]
column = "v"
unit = "km/h"
[heading]
column = "course"
quality = "ok"
[position]
latitude = "lat"
longitude = "lon"
quality = "fix"
accepted = ["fixed"]
"""
"""Map that the owner writes, without centre, scale, sign and latencies."""


def answers(h):
    """Return the true value of each quantity in the result of a fit, by key of the quantity."""
    weight = MASS / (L_F + L_R)
    return {
        "steer.offset": h.centre,
        "steer.scale": abs(h.scale),
        "heading.delay_s": h.heading_age,
        "heading.offset": h.heading_off,
        "position.delay_s": h.position_age,
        "speed.delay_s": h.speed_age,
        "position.ahead_m": h.ahead,
        "position.left_m": h.left,
        "front_cornering_stiffness_n_rad": h.C_f,
        "rear_cornering_stiffness_n_rad": h.C_r,
        "understeer_gradient_rad_s2_m": weight * (L_R / h.C_f - L_F / h.C_r),
        "front_relaxation_length_m": h.sigma_f,
        "rear_relaxation_length_m": h.sigma_r,
        "backlash_deg": h.play,
    }
