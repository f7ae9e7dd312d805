"""Energy balance

From rest, the tractor drives up and along a slope of 8 degrees on a weaving path and ends at 3 m/s. The powers are
summed over every physics step: input of the hydrostat and of the steering pump, work of gravity, and all losses. Tyre
losses are computed from the forces reported by the tyres and the motion of the wheels, independently of the wrench
applied in MuJoCo. These losses are force times sliding velocity, rolling resistance about the axle, soil resistance,
and twisting of the patch. The balance therefore also verifies that the wrench does the work reported by the tyre,
including the effective rolling radius. The residual is compared with the change of kinetic energy.
"""

from collections.abc import Iterator
from math import sin
from typing import Any

import mujoco
import numpy as np

from agrobot_mj.core.signals import TICK_S, Array, Drive
from agrobot_mj.extensions.bench.manoeuvres.base import Check, Trial, force_tyres
from agrobot_mj.plants import MujocoPlant
from agrobot_mj.plants.driver import Driver
from agrobot_mj.plants.mujoco.stepping import DRIVE, STEERING
from agrobot_mj.terrain import Slope
from agrobot_mj.tyres.base import Footing, Slip
from agrobot_mj.tyres.laws import direction_of_travel
from agrobot_mj.tyres.patch import CREEP_SPEED, FORCE_X, FORCE_Y, LOAD, SLIP_RATIO, soft_sign

SLOPE = Slope(grade_deg=8.0, direction_deg=60.0)
SPEED_M_S, DURATION_S, BRIEFLY_S = 3.0, 20.0, 4.0
DT_S = 0.002
BAND = 0.02  # Maximum residual of the balance divided by the change of kinetic energy [-]


class Wheel:
    """Geometry of one wheel at the start of a physics step, from which the powers of its tyre are computed."""

    def __init__(self, plant: MujocoPlant, i: int, normal: Array) -> None:
        body = plant.views.wheels[i]
        self.plant, self.i, self.body, self.n = plant, i, body, normal
        self.centre = plant.data.xpos[body].copy()
        self.footing = Footing(1.0, plant.tyred.tyres.cone_index)
        self.axle = plant.data.xmat[body].reshape(3, 3)[:, 1].copy()
        down = (normal @ self.axle) * self.axle - normal
        self.down = down / np.linalg.norm(down)

    def powers(self, velocity: Array, spin: Array) -> tuple[float, float, float]:
        """Return three powers of the tyre in a physics step [W]: losses, vertical damping, and power stored in the tyre
        spring. `velocity` and `spin` are the mid-step velocities of the wheel, shape (3,)."""
        plant, i, n, t = self.plant, self.i, self.n, self.plant.tyred.tyres
        report, wrench = plant.tyred.report[i], plant.data.xfrc_applied[self.body]
        tip = self.centre + t.radius[i] * self.down
        sunk = -float(tip @ n)
        arm = (t.radius[i] - sunk) * self.down
        forward = np.cross(self.axle, n)
        forward /= np.linalg.norm(forward)
        left = np.cross(n, forward)
        omega = float(spin @ self.axle)
        carrier = spin - omega * self.axle
        v = velocity + np.cross(carrier, arm)
        load, f_y = report[LOAD], report[FORCE_Y]
        r_e, rolled = t.radius[i] - sunk / 3, abs(float(v @ forward))
        referred = max(rolled, abs(omega) * r_e / 2, 1e-9)
        way = soft_sign(float(v @ forward), CREEP_SPEED)
        driving = direction_of_travel(float(v @ forward), omega * r_e) * report[SLIP_RATIO]
        slip = Slip(-driving * rolled / referred, 0.0, load, sunk, referred, self.footing, way)
        soil = -float((t.front if i < 2 else t.rear).drag(slip, way))
        f_x = report[FORCE_X] + soil
        sliding = -f_x * (v @ forward - r_e * omega) - f_y * (v @ left)
        rolling = t.rolling_resistance * load * r_e * abs(omega) + soil * (velocity @ forward)
        # The tread moves over the ground with the complete rotation of the wheel, including the spin of a tilted axle.
        torque = wrench[3:] - np.cross(arm, f_x * forward + f_y * left + load * n)
        twisting = -float(torque @ n) * float(spin @ n)
        squeezed = -load * float(v @ n)
        spring = t.stiffness[i] * sunk * -float(v @ n)
        return sliding + rolling + twisting, squeezed - spring, spring


class Books:
    """Energy balance of a plant: sums of all energies since the start [J]."""

    def __init__(self, plant: MujocoPlant) -> None:
        self.plant = plant
        x_min, x_max, y_min, y_max = plant.ground.extent
        h = plant.ground.heights
        slope = np.array([(h[0, 0] - h[0, 1]) / (x_max - x_min), (h[0, 0] - h[1, 0]) / (y_max - y_min), 1.0])
        self.normal = slope / np.linalg.norm(slope)
        plant.model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_ENERGY
        self.start = self.energies()
        self.engine = self.hydraulic = self.tyres = self.damping = self.springs = 0.0
        self.jacobians = np.zeros((2, 3, plant.model.nv))

    def energies(self) -> Array:
        """Return the potential and kinetic energy of the plant, shape (2,) [J]."""
        mujoco.mj_forward(self.plant.model, self.plant.data)
        return np.array(self.plant.data.energy, dtype=np.float64)

    def step(self, drive: Drive) -> Any:
        """Advance the plant by one physics step, add the energies of the step to the sums, and return the true
        state."""
        plant, data = self.plant, self.plant.data
        before = data.qvel.copy()
        wheels = [Wheel(plant, i, self.normal) for i in range(4)]
        truth = plant.advance(drive)
        middle = (before + data.qvel) / 2
        for wheel in wheels:
            along, about = self.jacobians
            mujoco.mj_jac(plant.model, data, along, about, wheel.centre, wheel.body)
            lost, damped, squeezed = wheel.powers(along @ middle, about @ middle)
            self.tyres += DT_S * lost
            self.damping += DT_S * damped
            self.springs += DT_S * squeezed
        self.damping -= DT_S * float(data.qfrc_passive @ middle)
        given = data.actuator_force[[STEERING, DRIVE]] @ data.ctrl[[STEERING, DRIVE]]
        self.engine += DT_S * float(given)
        self.hydraulic += DT_S * float(given - data.qfrc_actuator @ middle)
        return truth

    def close(self) -> tuple[float, float, float]:
        """Return the loss of potential energy, the gain of kinetic energy, and the residual of the balance [J]."""
        potential, kinetic = self.energies() - self.start
        lost = self.hydraulic + self.tyres + self.damping + self.springs
        return -float(potential), float(kinetic), float(self.engine - potential - lost - kinetic)


def balance(plant: MujocoPlant, truth: Any, seconds: float) -> Books:
    """Simulate the weaving path with one plant call per physics step, and return the energy sums."""
    books, driver = Books(plant), Driver(plant, truth, SPEED_M_S)
    for step in range(round(seconds / DT_S)):
        if step % round(TICK_S / DT_S) == 0:
            driver.truth = truth
            drive = Drive(driver.steer_voltage(0.25 * sin(0.8 * truth.t)), driver.pedal_voltage())
        truth = books.step(drive)
    return books


def run(m: Trial) -> Iterator[Check]:
    """Yield checks of the energy balance for every tyre with a force law. Quick mode simulates only a few seconds."""
    for tyre in force_tyres():
        plant, truth = m.mujoco(tyre, SLOPE, dt=DT_S, tick_s=DT_S)
        books = balance(plant, truth, BRIEFLY_S if m.quick else DURATION_S)
        fallen, kinetic, left_over = books.close()
        for quantity, energy in (
            ("work of hydrostat and steering pump", books.engine),
            ("loss of potential energy", fallen),
            ("hydraulic losses and oil springs", books.hydraulic),
            ("dampers and tyre springs", books.damping + books.springs),
            ("change of kinetic energy", kinetic),
        ):
            yield m.about(quantity, tyre.kind, "J").reported(energy)
        yield m.about("tyre losses", tyre.kind, "J").above(books.tyres, 0.0)
        about = m.about("energy residual divided by the change of kinetic energy", tyre.kind, "%")
        yield about.below(100 * left_over / kinetic, 100 * BAND)
