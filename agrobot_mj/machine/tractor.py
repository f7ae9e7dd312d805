"""The tractor in numbers: a compact tractor of the CNH TZ25DA class.

`models/tractor.xml` holds the same numbers for MuJoCo's own viewer; a test compares the two. Everything marked
*estimate* is ours, chosen inside ranges that `docs/models.md` names.
"""

from math import radians

from pydantic import Field, model_validator

from agrobot_mj.core.spec import Fraction, NonNegative, Positive, Spec

GRAVITY = 9.81
"""Standard gravity as MuJoCo's default has it [m/s2]."""


class TractorParameters(Spec):
    """Geometry, masses and tyre sizes; every key is a scenario key under `[tractor]`."""

    wheelbase_m: Positive = 1.40
    """L, front to rear axle [m]. Estimate."""
    track_m: Positive = 1.00
    """Between the wheels' centre planes, both axles [m]. Estimate."""
    mass_kg: Positive = 750.0
    """m, whole tractor ready to work [kg]. Estimate (700-800)."""
    front_load_fraction: Fraction = 0.38
    """Static share of weight on the front axle [-]. Published range for tractors 0.35-0.40."""
    cg_height_m: Positive = 0.55
    """CG above level ground at static load [m]. Estimate."""
    yaw_inertia_kg_m2: Positive = 400.0
    """I_z of the whole tractor about its CG [kg m2]. Estimate (350-450)."""
    roll_inertia_kg_m2: Positive = 120.0
    """I_x of the whole tractor about its CG [kg m2]. Estimate."""
    pitch_inertia_kg_m2: Positive = 340.0
    """I_y of the whole tractor about its CG [kg m2]. Estimate."""
    front_wheel_radius_m: Positive = 0.28
    """Free radius [m]. Estimate, 6-12 class tyre."""
    rear_wheel_radius_m: Positive = 0.42
    """Free radius [m]. Estimate, 9.5-16 class tyre."""
    front_wheel_width_m: Positive = 0.16
    """Section width [m]. Estimate."""
    rear_wheel_width_m: Positive = 0.24
    """Section width [m]. Estimate."""
    front_wheel_mass_kg: Positive = 18.0
    """One wheel with tyre [kg]. Estimate."""
    rear_wheel_mass_kg: Positive = 45.0
    """One wheel with tyre [kg]. Estimate."""
    front_tyre_stiffness_n_m: Positive = 1.2e5
    """Vertical, one tyre [N/m]. Estimate."""
    rear_tyre_stiffness_n_m: Positive = 1.6e5
    """Vertical, one tyre [N/m]. Estimate."""
    front_tyre_damping_n_s_m: NonNegative = 1200.0
    """Vertical, one tyre [N s/m]. Estimate: 15 % of critical for the load it carries."""
    rear_tyre_damping_n_s_m: NonNegative = 1800.0
    """Vertical, one tyre [N s/m]. Estimate: 15 % of critical for the load it carries."""
    axle_pivot_limit_deg: Positive = 10.0
    """Stops of the oscillating front axle, either way [deg]. Estimate (8-12)."""
    steer_limit_deg: Positive = Field(45.0, le=60.0)
    """Stops of the steering at the bicycle's virtual wheel, either way [deg]. Paper, section V-B."""
    antenna_height_m: NonNegative = 2.0
    """GNSS antenna above level ground, straight above the rear axle [m]. Paper, section V-A."""
    hitch_behind_m: NonNegative = 0.55
    """Hitch behind the rear axle [m]. Estimate (0.45-0.7)."""
    hitch_height_m: NonNegative = 0.35
    """Hitch above level ground [m]. Estimate (0.3-0.45)."""

    @model_validator(mode="after")
    def _cg_between_the_axles(self) -> "TractorParameters":
        if not 0.05 <= self.front_load_fraction <= 0.95:
            raise ValueError("front_load_fraction: must lie between 0.05 and 0.95, else an axle carries nothing")
        return self

    @property
    def cg_to_rear_axle(self) -> float:
        """l_r [m]."""
        return self.wheelbase_m * self.front_load_fraction

    @property
    def cg_to_front_axle(self) -> float:
        """l_f [m]."""
        return self.wheelbase_m - self.cg_to_rear_axle

    @property
    def steer_limit(self) -> float:
        """[rad]."""
        return radians(self.steer_limit_deg)

    @property
    def front_axle_load(self) -> float:
        """Static, both wheels, level ground [N]."""
        return self.mass_kg * GRAVITY * self.front_load_fraction

    @property
    def rear_axle_load(self) -> float:
        """Static, both wheels, level ground [N]."""
        return self.mass_kg * GRAVITY * (1 - self.front_load_fraction)
