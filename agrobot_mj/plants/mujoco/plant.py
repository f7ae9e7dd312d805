"""Plant that simulates the tractor with MuJoCo."""

import sys
from math import hypot

import mujoco
import numpy as np

from agrobot_mj.core.geometry import wrap
from agrobot_mj.core.held import Held
from agrobot_mj.core.interrupts import deliver
from agrobot_mj.core.kernels import held
from agrobot_mj.core.signals import NEUTRAL_V, NOMINAL, WHEELS, Array, Conditions, Drive, Reference, Truth
from agrobot_mj.machine import Machine
from agrobot_mj.machine.driveline import drive_law, reset_drive
from agrobot_mj.machine.hydraulics import reset_valve, valve_law, worn_valve
from agrobot_mj.machine.tractor import GRAVITY
from agrobot_mj.plants.base import Clock, PlantCode, RunningPlant, copies, write
from agrobot_mj.plants.mujoco.build import Mujoco, Payloads, build
from agrobot_mj.plants.mujoco.c_api import flags_of
from agrobot_mj.plants.mujoco.clearance import clearance_of
from agrobot_mj.plants.mujoco.clutches import Clutches
from agrobot_mj.plants.mujoco.drawing import poses_of
from agrobot_mj.plants.mujoco.implement import memories_of
from agrobot_mj.plants.mujoco.loads import AHEAD, CENTRE, HUNG, LEFT, PULL, SIDE, no_loads
from agrobot_mj.plants.mujoco.native_contact import NativeContacts
from agrobot_mj.plants.mujoco.payload import Chassis
from agrobot_mj.plants.mujoco.saving import INTEGRATION, MujocoState, step_results
from agrobot_mj.plants.mujoco.settling import REST_M_S, RecentMotion, Settled, Tilt, drive_holds, pose_on, start_warning
from agrobot_mj.plants.mujoco.stepping import Actuators, Assembly, Tyred, implement_values, look, oil_of, run_steps
from agrobot_mj.plants.mujoco.views import CHASSIS, views_of
from agrobot_mj.terrain import Ground
from agrobot_mj.terrain.memory import AnyArray, RutMap, forget, restore, rut_map, save_memory
from agrobot_mj.tyres.laws import with_soil_memory

CLOCK = Clock()
STICKING_SPIN, STICKING_CONTACT = 0.03, 1e4
"""Factors on MuJoCo's `dof_invweight0` of the wheels and on MuJoCo's `impratio` while the brake is applied [-].

The factors reduce the creep of MuJoCo's dry friction under load. On a slope of 10 deg the creep is 0.2 um/s, or 0.15
um/s with the tyre `contact`.
"""
OFFSET_M, PLACINGS = 0.001, 3
"""Distance from the start above which a settled tractor is placed again [m], and maximum number of placements [-]."""


class MujocoPlant(RunningPlant):
    """Plant in a run that simulates the tractor with MuJoCo."""

    def __init__(
        self,
        spec: Mujoco,
        machine: Machine,
        ground: Ground,
        clock: Clock = CLOCK,
        seed: int = 1,
        payloads: Payloads = (),
    ) -> None:
        self.spec, self.machine, self.tractor = spec, machine, machine.tractor
        native = spec.tyre.native
        built = build(spec.tyre, machine, ground, clock.dt, seed, payloads)
        self.model, self.scene, tyres, hitched, self.attached = built
        self.ground = ground = with_soil_memory(ground, tyres.bearing)
        self.data = mujoco.MjData(self.model)
        self.views = views_of(self.model, self.data)
        self.tyred = Tyred(native is not None, tyres, ground, np.zeros((4, 4)), np.zeros((4, 6)))
        self.has_implement = hitched is not None
        self.contacts = None if native is None else NativeContacts(self.model, self.data, ground, tyres, native)
        self.vertical = tyres.stiffness.copy()
        self.clutches = Clutches(self.model, self.data, machine)
        self.oil = oil_of(machine)
        self.nominal_valve, self.valve_memory = valve_law(machine.valve, clock.dt)
        self.conditions = NOMINAL
        drive, self.drive_memory = drive_law(machine.driveline, clock.dt)
        self.brake_torques, self.braking = machine.driveline.brake_torques(machine.tractor), 0.0
        self.spins_v = [int(self.model.joint(f"spin_{wheel}").dofadr[0]) for wheel in WHEELS]
        self.loads = no_loads(machine.tractor.hitch_behind_m, machine.tractor.hitch_height_m)
        self.chassis = Chassis(self.model)
        self.spin_weights = self.model.dof_invweight0[self.spins_v].copy()
        self.samples, self.cylinder = np.zeros((4, clock.steps)), np.zeros(1)
        self.actuators = Actuators(
            self.oil, self.nominal_valve, self.valve_memory, drive, self.drive_memory, self.cylinder
        )
        self.settle_ticks = round(spec.settle_s / clock.tick_s)
        self.tick_s, self.ticks = clock.tick_s, 0
        self.sites = np.array(self.model.site("cg").pos), np.array(self.model.site("antenna").pos)
        self.clearance, self.clear = clearance_of(self.model), False
        self.option, self.rig = self.model.opt, self._rig()
        shown = self.tyred.report, *poses_of(self.data)
        self._compile(shown, run_steps, look, *([implement_values] if self.has_implement else []))
        self._look()

    def reset(self, start: Reference, conditions: Conditions = NOMINAL) -> Truth:
        """Place the tractor with its CG above the start of the path, let it settle to rest, and return the true state.

        On a slope the tractor moves downhill while its tyres deflect; the tractor is then placed again, uphill by the
        distance of this motion. If the tractor does not come to rest or has rolled over, a warning is printed, and the
        run starts in this state.
        """
        self._apply_conditions(conditions)
        place = before = start
        for _ in range(PLACINGS):
            truth, recent = self._settle_at(place)
            if self._fallen and place is not before:
                truth, recent = self._settle_at(
                    before
                )  # near its tip-over angle it only rests if it turns on its tyres
                break
            before = place
            off_x, off_y, turned = truth.x - start.x, truth.y - start.y, wrap(truth.yaw - start.yaw)
            if not self.settle_ticks or not recent.greatest <= REST_M_S or hypot(off_x, off_y) < OFFSET_M:
                break
            place = place._replace(x=place.x - off_x, y=place.y - off_y, yaw=place.yaw - turned)
        if self.settle_ticks:
            mass, wheels = float(self.model.body_subtreemass[CHASSIS]), self.wheels().reshape(6, 4).T
            found = Settled(truth, recent, mass, wheels, self._fallen)
            if why := start_warning(found, recent.ticks * self.tick_s, self.machine, self.ground):
                print(why, file=sys.stderr)
        return truth

    def _settle_at(self, place: Reference) -> tuple[Truth, RecentMotion]:
        """Place the tractor with its CG above `place` and let it settle. Return the true state and the motion."""
        self._place(place)
        recent = self._settle()
        mujoco.mj_forward(self.model, self.data)
        self.ticks = 0
        return self.truth(), recent

    def _place(self, start: Reference) -> None:
        mujoco.mj_resetData(self.model, self.data)
        self.tyred.bristles[:], self.tyred.report[:] = 0.0, 0.0
        forget(self.ground.memory)
        self.loads[AHEAD], self.loads[LEFT], self.cylinder[0] = 0.0, 0.0, 0.0
        for array in memories_of(self.attached):
            array[:] = 0.0
        reset_valve(self.valve_memory)
        reset_drive(self.drive_memory)
        self.clutches.reset()
        self.data.qpos[:7], roll = pose_on(self.ground, start, self.tractor)
        if (pivot := mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_JOINT, "axle_roll")) >= 0:
            self.data.qpos[self.model.jnt_qposadr[pivot]] = roll
        self._update_bodies()

    def _settle(self) -> RecentMotion:
        """Simulate with valves in neutral until the tractor is at rest, rolls over or moves away; return its motion.

        The brake is applied if the tyres use MuJoCo contact or the hydrostat cannot hold the tractor. `settle_limit_s`
        limits the duration.
        """
        brake, recent = float(self.contacts is not None), RecentMotion(self.tick_s)
        tilt, gravity = Tilt(self.data.xmat[CHASSIS][2::3], self.tick_s), self.option.gravity.copy()
        least, limit = max(self.settle_ticks, tilt.ticks), tilt.ticks + round(self.spec.settle_limit_s / self.tick_s)
        try:
            for tick in range(max(least, limit) if self.settle_ticks else 0):
                deliver()
                if tilt.ticks:
                    self.option.gravity[:] = -GRAVITY * tilt.up(tick)
                self.step_through(Drive(NEUTRAL_V, NEUTRAL_V, brake))
                self._look()
                if not drive_holds(self.oil, self.machine.driveline.connected, self.motion.actuation[2]):
                    brake = 1.0
                recent.add(self.motion)
                rests = tick + 1 >= least and recent.greatest < REST_M_S
                if rests or self._fallen or recent.gone:
                    break
        finally:
            self.option.gravity[:] = gravity
        return recent

    def advance_held(self, drive: Drive, conditions: Conditions = NOMINAL) -> Held[Truth]:
        """Simulate one tick as in `advance`; return a `Held` reference to the true state, which saves time."""
        if self.clutches.switched:
            self.clutches.update(self.motion)
        return super().advance_held(drive, conditions)

    def step_through(self, drive: Drive) -> None:
        """Simulate the physics steps of one tick at constant valve voltages, without computing the true state."""
        if self.contacts:
            self.contacts.set_friction()
        if drive.brake != self.braking:
            self._brake(drive.brake)
        super().step_through(drive)

    def code(self) -> PlantCode | None:
        """Return the data for ticks that run in compiled code, or None if ticks need Python (switched clutches, MuJoCo
        contact)."""
        return None if self.contacts or self.clutches.switched else super().code()

    def _brake(self, share: float) -> None:
        """Apply the fraction `share` [-] of the brake torque as dry friction at the wheels, with reduced creep."""
        stands = share > 0.0
        self.model.dof_frictionloss[self.spins_v] = share * self.brake_torques
        self.model.dof_invweight0[self.spins_v] = self.spin_weights * (STICKING_SPIN if stands else 1.0)
        if self.contacts:
            self.option.impratio = self.contacts.impratio * (STICKING_CONTACT if stands else 1.0)

    def _rig(self) -> Assembly:
        moved = self.views, self.tyred, self.attached, self.loads, self.actuators, self.samples, self.clearance
        return held(Assembly(*moved, *self.sites, flags_of(self.model)), as_it_is=True)

    def _apply_conditions(self, conditions: Conditions) -> None:
        self.chassis.carry(conditions.payload)
        before, self.conditions = self.conditions, conditions
        wear = conditions.valve_gain, conditions.valve_dead_band
        if wear != (before.valve_gain, before.valve_dead_band):
            self.actuators = self.actuators._replace(valve=worn_valve(self.nominal_valve, *wear))
            self.rig = self._rig()
        tyres = self.tyred.tyres
        tyres.grip[:] = conditions.grip
        tyres.carcass[:, 0], tyres.carcass[:, 1] = conditions.tyre_stiffness, conditions.tyre_rolling
        tyres.stiffness[:] = self.vertical * tyres.carcass[:, 0]
        self.loads[PULL], self.loads[SIDE] = conditions.drawbar, conditions.side_force
        self.loads[CENTRE:HUNG] = self.model.body_ipos[CHASSIS]
        if self.has_implement:
            self.attached.tyres.grip[:] = conditions.grip
            hung = self.model.body_subtreemass[self.attached.body]
            self.loads[HUNG] = hung / (self.model.body_subtreemass[CHASSIS] - hung)
        if not conditions.drawbar:
            self.loads[AHEAD], self.loads[LEFT] = 0.0, 0.0
        self.data.xfrc_applied[CHASSIS] = 0.0

    @property
    def _memories(self) -> tuple[AnyArray, ...]:
        tyred, valve, drive = self.tyred, self.valve_memory, self.drive_memory
        hung = memories_of(self.attached) if self.has_implement else ()
        own = tyred.bristles, tyred.report, tyred.tyres.relaxation, self.loads, self.samples, self.cylinder
        return *own, *valve, *drive, *hung, *self.clutches.memories

    def save(self) -> MujocoState:
        """Return a copy of the plant's current state: a few kilobytes, plus 33 kB per tile of soil with ruts."""
        physics = np.empty(mujoco.mj_stateSize(self.model, INTEGRATION))
        mujoco.mj_getState(self.model, self.data, physics, INTEGRATION)
        return MujocoState(
            physics=physics,
            left=copies(step_results(self.model, self.data)),
            memories=copies(self._memories),
            conditions=self.conditions,
            ticks=self.ticks,
            soil=save_memory(self.ground.memory),
        )

    def restore(self, state: MujocoState) -> None:
        """Restore a saved state bit-exactly."""
        if state.conditions != self.conditions:
            self._apply_conditions(state.conditions)
        mujoco.mj_setState(self.model, self.data, state.physics, INTEGRATION)
        self._update_bodies()
        write(step_results(self.model, self.data), state.left)
        write(self._memories, state.memories)
        restore(self.ground.memory, state.soil)
        self.ticks = state.ticks
        self._look()

    def configuration(self) -> Array:
        """Return MuJoCo's generalised positions (`qpos`) of the tractor, shape (nq,)."""
        return np.array(self.data.qpos)

    def wheels(self) -> Array:
        """Return the six tyre quantities in the order of `tyres.patch`, each for four wheels, shape (24,)."""
        if self.contacts:
            self.contacts.read(self.tyred.report)
        return super().wheels()

    def ruts(self) -> RutMap | None:
        """Return the ruts on the field, or None if the ground has no plastic soil."""
        return rut_map(self.ground.memory) if self.ground.memory.tiles.size else None

    def warnings(self) -> int:
        """Return the number of MuJoCo warnings since the reset."""
        return int(self.data.warning.number.sum())

    @property
    def _fallen(self) -> bool:
        return self.trouble() == "rolled_over"
