"""Theory of the tractor: loads, slip angles and tipping under a steady lateral acceleration, from parameters only.

The vehicle axes are x (forward), y (left) and z (up), with the origin R below the rear axle. In the frame of the
tractor, a side slope `grade` with the left side uphill is equivalent to a left bend: lateral acceleration a = g
sin(grade) and gravity g_n = g cos(grade); a bend on level ground has a = u gamma and g_n = g. The tyre forces on the
tractor sum to m a to the left; the right side carries more load.

Symbols: speed u, yaw rate gamma, wheelbase L, track T, vertical stiffness k of a rear tyre, height h_P of the pivot P,
front wheel radius r_f, wheel loads N_i, axle forces F_f and F_r, and lateral drag component D of steered front wheels.
The front axle is mounted on the roll pivot P, which transmits no roll moment within its stops. For the body (index b:
chassis and rear wheels) and the front assembly (index f), each with mass, CG and height:

    pivot     V = m_b g_n x_b / L (vertical),  H = F_f - D - m_f a (lateral)        balance of the front assembly
    rear      (N_rr - N_rl) T / 2 = m_b z_b a - h_P H + G g_n phi + sum(N_i s_i)    roll about the rear patches
    tyres     N_rr - N_rl = k T phi,  G = m_b (z_b - h_P x_b / L)                   roll phi on the tyre springs
    front     (N_fr - N_fl) T / 2 = h_P (F_f + V phi_f) - (h_P - r_f) D             roll phi_f of the axle about P
                                    - m_f ((h_P - z_f) a - z_f g_n phi_f) + sum(N_i s_i)

The lateral force F_i moves a patch by s_i = F_i / c against its wheel, on the lateral stiffness c of the carcass.
Rolling and soil resistance rho_i N_i shift load from the front to the rear axle by sum(rho_i N_i r_i) / L. The
resistance is larger on the more loaded side and turns the tractor towards that side: M = (T / 2) sum(+-rho_i N_i).
Pneumatic trails t_i add -t_i F_i. F_f + F_r = m a and l_f F_f - l_r F_r + M = 0 then give the forces of both axles, and
the tyre law gives their slip angles. Without resistance and trail: F_f / F_r = l_r / l_f. In a bend, the patches scrub
against turning, and the gyroscopic moment of the wheels adds to the roll. Resistances act at the height of the wheel
centres; on a rolled body they turn the tractor out of the bend.
"""

from math import cos, degrees, radians, sin, tan
from typing import Any, NamedTuple

import mujoco
import numpy as np
from scipy.optimize import brentq

from agrobot_mj.core.signals import Array
from agrobot_mj.machine import Machine
from agrobot_mj.machine.linkage import DRY_GRIP
from agrobot_mj.machine.tractor import GRAVITY, TractorParameters
from agrobot_mj.plants.mujoco.model import SPIN_GYRATION_2, tractor_spec
from agrobot_mj.tyres import Linear, MagicFormula
from agrobot_mj.tyres.base import Footing, Slip, TyreLaw
from agrobot_mj.tyres.laws import TRAIL_SLIP, tyre_set

ROLLING_M_S = 1.0
"""Speed for evaluating tyre laws [m/s]. At this speed, forces that fade out near standstill have their full
magnitude."""


STOCK, LINEAR = TractorParameters(), Linear()
Pair = tuple[float, float]


class Parts(NamedTuple):
    """Masses and positions of the two bodies joined by the roll pivot of the front axle."""

    body_kg: float  # Mass m_b of the body [kg]
    body_x: float  # Distance x_b of the body's CG ahead of the rear axle [m]
    body_z: float  # Height z_b of the body's CG [m]
    front_kg: float  # Mass m_f of the front assembly: axle, knuckles and front wheels [kg]
    front_z: float  # Height z_f of the CG of the front assembly [m]
    pivot_z: float  # Height h_P of the roll pivot [m]


def parts(tractor: TractorParameters) -> Parts:
    """Return masses and positions of the body and of the front assembly, from the compiled MuJoCo model at static
    load."""
    model = tractor_spec(Machine(tractor)).compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    pivot = model.joint("axle_roll").id
    axle = model.jnt_bodyid[pivot]
    m, m_f = tractor.mass_kg, float(model.body_subtreemass[axle])
    front = data.subtree_com[axle]
    whole = np.array([tractor.cg_to_rear_axle, 0.0, tractor.cg_height_m])
    body = (m * whole - m_f * front) / (m - m_f)
    return Parts(m - m_f, body[0], body[2], m_f, front[2], data.xanchor[pivot][2])


class Loads(NamedTuple):
    """Wheel loads under a steady lateral acceleration."""

    wheels: Array  # Loads of the wheels front left, front right, rear left and rear right, shape (4,) [N]
    lean: float  # Roll angle phi of the body [rad], positive to the right


class Balance(NamedTuple):
    """Steady state of a tractor under a constant lateral acceleration."""

    loads: Loads
    front_slip: float  # Slip angle of the front wheels [rad], positive for a force to the left
    rear_slip: float  # Slip angle of the rear wheels [rad], positive for a force to the left


class Tractor:
    """Theory of the steady states of a tractor with a given tyre type."""

    def __init__(self, tractor: TractorParameters = STOCK, tyre: Any = LINEAR) -> None:
        self.p, self.parts, self.tyres = tractor, parts(tractor), tyre_set(tyre, tractor)
        self.footing = Footing(1.0, self.tyres.cone_index)

    def static(self, i: int) -> float:
        """Return the static load of wheel `i` on level ground [N]."""
        return (self.p.front_axle_load if i < 2 else self.p.rear_axle_load) / 2

    def loads(
        self,
        a: float,
        g_n: float,
        front_force: float,
        shift: float = 0.0,
        bend: bool = False,
        aside: Pair = (0.0, 0.0),
        dragged: float = 0.0,
        inward: float = 0.0,
    ) -> Loads:
        """Return the wheel loads and the roll angle at lateral acceleration `a` and gravity `g_n` normal to the ground
        [m/s2]. `front_force` is the front side force F_f, and `shift` the load transfer to the rear axle [N]. `bend`
        adds the gyroscopic moments of the wheels.

        `aside` is the sum of load times lateral displacement of the contact patches, for each axle [N m]. `dragged` is
        the lateral component D of the drag of steered front wheels [N]. `inward` is the difference between the inward
        displacements of the outer and the inner rear patch [m], which increases the roll angle.
        """
        p, b = self.p, self.parts
        L, T, k_f, k = p.wheelbase_m, p.track_m, p.front_wheel.stiffness, p.rear_wheel.stiffness
        J_f, J_r = self.gyroscopes() if bend else (0.0, 0.0)
        rise = (1 - g_n / GRAVITY) * p.rear_axle_load / (2 * k)
        G = b.body_kg * (b.body_z + rise - (b.pivot_z + rise) * b.body_x / L)
        pivot = front_force - dragged - b.front_kg * a
        moment = b.body_kg * (b.body_z + rise) * a - pivot * (b.pivot_z + rise)
        lean = (moment + J_r * a + aside[1]) / (k * T * (T - inward) / 2 - G * g_n)
        front = p.mass_kg * g_n * p.cg_to_rear_axle / L - shift
        rear = p.mass_kg * g_n - front
        tips = b.pivot_z * front_force - (b.pivot_z - p.front_wheel_radius_m) * dragged
        tips += J_f * a + aside[0] - (b.pivot_z - b.front_z) * b.front_kg * a
        over = tips / (T - 2 * (b.pivot_z * (front - b.front_kg * g_n) + b.front_z * b.front_kg * g_n) / (k_f * T))
        half = k * (T - inward) * lean / 2
        return Loads(np.array([front / 2 - over, front / 2 + over, rear / 2 - half, rear / 2 + half]), lean)

    def aside(self, loads: Array, forces: Array) -> Pair:
        """Return the sum of wheel load times lateral patch displacement for each axle [N m], from the loads and the
        lateral forces of the wheels (4,) [N]. The sums are zero for tyres whose load does not move with the patch."""
        if not self.tyres.load_follows:
            return 0.0, 0.0
        moments = loads * forces / self.tyres.springs[:, 1]
        return float(moments[:2].sum()), float(moments[2:].sum())

    def gyroscopes(self) -> tuple[float, float]:
        """Return the spin inertia divided by the rolling radius [kg m], summed over the wheels of each axle."""
        p = self.p
        front, rear = p.front_wheel_mass_kg * p.front_wheel_radius_m, p.rear_wheel_mass_kg * p.rear_wheel_radius_m
        return 2 * SPIN_GYRATION_2 * front, 2 * SPIN_GYRATION_2 * rear

    def slip(self, i: int, x: float, y: float, load: float) -> tuple[TyreLaw, Slip]:
        """Return tyre law and slip state of wheel `i` for longitudinal and lateral slip `x`, `y` [-] and a load [N]."""
        t = self.tyres
        return (t.front if i < 2 else t.rear), Slip(x, y, load, load / t.stiffness[i], ROLLING_M_S, self.footing)

    def lateral(self, i: int, slip: float, load: float) -> float:
        """Return the lateral force of wheel `i` [N] that opposes a slip angle [rad], at a load [N]."""
        law, state = self.slip(i, 0.0, -tan(slip), load)
        return float(law.force(state).y)

    def resistance(self, i: int, load: float) -> float:
        """Return the rolling resistance rho_i N_i of wheel `i` plus, on soil, the drag of the towed wheel [N]."""
        own = self.tyres.rolling_resistance * load

        def missing(slip: float) -> float:
            law, state = self.slip(i, slip, 0.0, load)
            return own + float(law.force(state).x)

        slip = float(brentq(missing, 0.0, 0.5, xtol=1e-12)) if own > 0 else 0.0
        law, state = self.slip(i, slip, 0.0, load)
        return own - float(law.drag(state, 1.0))

    def rolling(self, grade: float = 0.0) -> tuple[Array, float]:
        """Return the effective rolling radii (4,) [m] and the total rolling resistance [N] on a slope `grade` [rad]."""
        loads = np.array([self.static(i) for i in range(4)]) * cos(grade)
        radii = self.tyres.radius - loads / self.tyres.stiffness / 3
        return radii, sum(self.resistance(i, loads[i]) for i in range(4))

    def axle_slip(self, wheels: tuple[int, int], loads: Array, wanted: float) -> float:
        """Return the slip angle at which the two wheels of an axle produce the lateral force `wanted` [N]. Raises
        ValueError if the force is too large."""

        def missing(slip: float) -> float:
            return sum(self.lateral(i, slip, loads[i]) for i in wheels) - wanted

        return float(brentq(missing, -0.5, 0.5, xtol=1e-12))

    def balance(self, a: float, g_n: float = GRAVITY, curvature: float = 0.0, rolling: bool = True) -> Balance:
        """Return the steady state at lateral acceleration `a` and gravity `g_n` normal to the ground [m/s2].

        `curvature` is the curvature of the path [1/m]. If `rolling` is false, the tractor is parked.
        """
        p = self.p
        l_f, l_r, L, T = p.cg_to_front_axle, p.cg_to_rear_axle, p.wheelbase_m, p.track_m
        front_force, shift, dragged, aside = p.mass_kg * a * l_r / L, 0.0, 0.0, (0.0, 0.0)
        rear_force = p.mass_kg * a - front_force
        for _ in range(40):
            loads = self.loads(a, g_n, front_force, shift, curvature != 0.0, aside, dragged)
            N = loads.wheels
            front_slip = self.axle_slip((0, 1), N, front_force)
            rear_slip = self.axle_slip((2, 3), N, rear_force)
            slips = (front_slip, front_slip, rear_slip, rear_slip)
            # at rest the carcasses of an axle deflect equally
            forces = [front_force / 2, front_force / 2, rear_force / 2, rear_force / 2]
            if rolling:
                forces = [self.lateral(i, slips[i], N[i]) for i in range(4)]
            aside = self.aside(N, np.array(forces))
            if not rolling:
                continue
            against = np.array([self.resistance(i, N[i]) for i in range(4)])
            shift = float(against @ (self.tyres.radius - N / self.tyres.stiffness)) / L
            steer = L * curvature + front_slip - rear_slip
            dragged = (against[0] + against[1]) * steer
            moment = T / 2 * float(against @ [1, -1, 1, -1]) - self.scrub(N, curvature) - dragged * l_f
            moment -= self.trail(front_slip) * front_force + self.trail(rear_slip) * rear_force
            moment -= loads.lean * self.leaning(against)
            sideways = p.mass_kg * a + dragged
            rear_force = (l_f * sideways + moment) / L
            front_force = (sideways - rear_force) / cos(steer)
        return Balance(loads, front_slip, rear_slip)

    def leaning(self, against: Array) -> float:
        """Return the yaw moment out of the bend that the wheel resistances `against` [N] cause in a tractor with a roll
        angle, divided by the roll angle [N m/rad].

        The rear wheels push at their contact patches, which are laterally offset from wheel centres and pivot. The open
        differential gives both wheels the same torque. The more compressed wheel, with its smaller rolling radius,
        pushes harder.
        """
        front, rear, radius = float(against[:2].sum()), float(against[2:].sum()), self.p.rear_wheel_radius_m
        return front * self.parts.pivot_z + rear * radius - (front + rear) * self.p.track_m**2 / (12 * radius)

    def scrub(self, loads: Array, curvature: float) -> float:
        """Return the yaw moment [N m] with which scrubbing patches resist turning at a path `curvature` [1/m]."""
        t = self.tyres
        rolls = t.twist_relaxation * t.twist_stiffness * abs(curvature)
        return float(np.minimum(rolls, DRY_GRIP * loads * t.scrub_arm).sum())

    def trail(self, slip: float) -> float:
        """Return the pneumatic trail of a tyre at a slip angle [m]."""
        return self.tyres.trail * float(np.exp(-abs(tan(slip)) / TRAIL_SLIP))

    def side_slope(self, grade_deg: float, rolling: bool = True) -> Balance:
        """Return the steady state of a rolling or parked tractor across a slope whose left side is uphill."""
        grade = radians(grade_deg)
        return self.balance(GRAVITY * sin(grade), GRAVITY * cos(grade), rolling=rolling)

    @property
    def axle_stiffness(self) -> tuple[float, float]:
        """Cornering stiffnesses of the front and rear axles at static loads on level ground [N/rad]."""
        small = 1e-5
        front, rear = (2 * self.lateral(i, small, self.static(i)) / small for i in (0, 2))
        return front, rear

    def understeer_gradient(self, speeds: Array, radius: float) -> float:
        """Return the understeer gradient [rad s2/m], fitted to bends of a `radius` [m] at the `speeds` [m/s]."""
        a = speeds**2 / radius
        states = [self.balance(value, curvature=1 / radius) for value in a]
        return float(np.polyfit(a, [state.front_slip - state.rear_slip for state in states], 1)[0])

    @property
    def tipping_deg(self) -> float:
        """Side slope at which the upper rear wheel leaves the ground [deg].

        The tipping axis is the line from the lower rear patch, which carries the complete side force, to the pivot:
        with rigid tyres tan(grade) = (T / 2) (L - x_b) / (L z_b - h_P x_b). The stops of the front axle have no effect,
        because they are not reached at this slope. Resting on the stops, the tractor would balance at the roll angle
        atan(T / 2 / h), which is smaller than this slope plus the travel of the pivot.
        """

        share, weight = self.p.cg_to_rear_axle / self.p.wheelbase_m, (1 - self.p.front_load_fraction) * self.p.mass_kg

        def upper_load(grade_deg: float) -> float:
            grade = radians(grade_deg)
            a, g_n = GRAVITY * sin(grade), GRAVITY * cos(grade)
            aside = self.aside(np.array([0.0, 0.0, 0.0, weight * g_n]), np.array([0.0, 0.0, 0.0, weight * a]))
            inward = aside[1] / (weight * g_n)
            return float(self.loads(a, g_n, self.p.mass_kg * a * share, aside=aside, inward=inward).wheels[2])

        return float(brentq(upper_load, 1.0, 60.0))


def understeer_gradient(tractor: TractorParameters, C_f: float, C_r: float) -> float:
    """Return the understeer gradient [rad s2/m] of the linear bicycle, K = m (l_r C_r - l_f C_f) / (L C_f C_r)."""
    l_f, l_r, L = tractor.cg_to_front_axle, tractor.cg_to_rear_axle, tractor.wheelbase_m
    return tractor.mass_kg * (l_r * C_r - l_f * C_f) / (L * C_f * C_r)


def crab_of_any_mass(tractor: TractorParameters, tyre: MagicFormula, grade_deg: float) -> float:
    """Return the theoretical mean slip angle [deg] of a tractor across a slope, with tyres sized to their static loads.

    The angle is sin(grade) divided by the mean ratio of stiffness to load, weighted by the axle load fractions.
    """
    share = tractor.front_load_fraction
    front, rear = share * tyre.front.lateral.stiffness_per_load, (1 - share) * tyre.rear.lateral.stiffness_per_load
    return degrees(sin(radians(grade_deg)) / (front + rear))
