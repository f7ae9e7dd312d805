"""The tractor in numbers: a compact tractor of the CNH TZ25DA class.

`models/tractor.xml` holds the same numbers for MuJoCo's own viewer; a test compares the two. Everything marked
*estimate* is ours, chosen inside the range that it states.
"""

from math import atan2, hypot, radians, sqrt, tan
from typing import Annotated, ClassVar, Literal, NamedTuple

from pydantic import AfterValidator, Field, model_validator

from agrobot_mj.core.spec import NonNegative, Positive, Spec, fill, printable

GRAVITY = 9.81
"""Standard gravity as MuJoCo's default has it [m/s2]."""
Body = Literal["open", "roll_bar", "cab", "robot"]
"""Appearance of a machine: a seat without roll bar, a seat below a roll bar or in a cab, or a deck without a seat."""
WITH_ROLL_BAR_KG, WITH_CAB_KG = 450.0, 2500.0
"""Masses from which a tractor is drawn with a roll bar and with a cab [kg]. Assumed value."""


class Springs(NamedTuple):
    """Reference tyre from which springs and dampers of larger and smaller tyres are scaled.

    Tyres of one shape with the same relative deflection: the stiffness scales with load divided by radius, and the
    damping ratio is constant at the carried load.
    """

    load: float
    """Static load [N]."""
    radius: float
    """Free radius [m]."""
    stiffness: float
    """Vertical stiffness [N/m]."""
    damping: float
    """Vertical damping [N s/m]."""

    def under(self, load: float, radius: float, stiffness: float | None, damping: float | None) -> tuple[float, float]:
        """Return the vertical stiffness [N/m] and damping [N s/m], as given or for this static load [N] and free radius
        [m]."""
        k = self.stiffness * (load / self.load) * (self.radius / radius) if stiffness is None else stiffness
        c = self.damping * sqrt(k / self.stiffness * (load / self.load)) if damping is None else damping
        return k, c


class AxleWheel(NamedTuple):
    """Wheel of an axle, left or right, with its tyre."""

    axle: str
    """Axle of a tractor, front or rear; rear for an implement."""
    radius: float
    """Free radius [m]."""
    width: float
    """Section width [m]."""
    mass: float
    """Mass [kg]."""
    load: float
    """Static load on level ground [N]."""
    stiffness: float
    """Vertical stiffness of the tyre [N/m]."""
    damping: float
    """Vertical damping of the tyre [N s/m]."""

    @property
    def deflection(self) -> float:
        """Deflection of the tyre under the static load [m]."""
        return self.load / self.stiffness


FRONT_TYRE = Springs(750.0 * GRAVITY * 0.38 / 2, 0.28, 1.2e5, 1200.0)
"""Front tyre of the default tractor. Assumed value: it deflects by 4 % of its radius, 15 % of critical damping."""
REAR_TYRE = Springs(750.0 * GRAVITY * (1 - 0.38) / 2, 0.42, 1.6e5, 1800.0)
"""Rear tyre of the default tractor. Assumed value: it deflects by 3 % of its radius, 15 % of critical damping."""


class TractorParameters(Spec):
    """Geometry, masses and tyre sizes; every key is a scenario key under `[tractor]`.

    Defaults are those of the compact tractor. Values that are not given follow from mass and wheelbase: lengths scale
    with the wheelbase, masses with the mass, the yaw inertia with mass times wheelbase squared, the other inertias with
    the yaw inertia. The antenna keeps its height above the rear wheels.
    """

    sized: ClassVar = {
        **{key: {"length": 1} for key in ("track_m", "cg_height_m", "hitch_behind_m", "hitch_height_m")},
        **{key: {"length": 1} for key in ("front_wheel_radius_m", "rear_wheel_radius_m")},
        **{key: {"length": 1} for key in ("front_wheel_width_m", "rear_wheel_width_m")},
        **{key: {"mass": 1} for key in ("front_wheel_mass_kg", "rear_wheel_mass_kg")},
        "yaw_inertia_kg_m2": {"mass": 1, "length": 2},
        **{key: {"yaw_inertia": 1} for key in ("roll_inertia_kg_m2", "pitch_inertia_kg_m2")},
    }

    wheelbase_m: Annotated[float, Field(ge=0.5, le=10)] = 1.40
    """Wheelbase L, front to rear axle [m]. Assumed value (1.4-1.6 for the class)."""
    track_m: Annotated[float, Field(ge=0.3, le=6)] = 1.00
    """Track width between the wheels' centre planes, both axles [m]. Assumed value (0.9-1.1, adjustable)."""
    mass_kg: Annotated[float, Field(ge=50, le=100000)] = 750.0
    """Mass m of the complete tractor, ready to work [kg]. Assumed value (700-800)."""
    front_load_fraction: Annotated[float, Field(ge=0.05, le=0.95)] = 0.38
    """Static fraction of weight on the front axle [-]. Assumed value: 0.35-0.40 is published for tractors."""
    cg_height_m: Annotated[float, Field(ge=0.05, le=5)] = 0.55
    """Height of the CG above level ground at static load [m]. Assumed value (0.5-0.7, with the rollbar)."""
    yaw_inertia_kg_m2: Positive = 400.0
    """Yaw inertia I_z of the complete tractor about its CG [kg m2]. Assumed value (350-450; gyration 0.73 m)."""
    roll_inertia_kg_m2: Positive = 120.0
    """Roll inertia I_x of the complete tractor about its CG [kg m2]. Assumed value (80-160; gyration 0.40 m)."""
    pitch_inertia_kg_m2: Positive = 340.0
    """Pitch inertia I_y of the complete tractor about its CG [kg m2]. Assumed value (280-400; gyration 0.67 m)."""
    front_wheel_radius_m: Annotated[float, Field(ge=0.1, le=2)] = 0.28
    """Free radius of a front wheel [m]. Assumed value, 6-12 class tyre."""
    rear_wheel_radius_m: Annotated[float, Field(ge=0.1, le=2)] = 0.42
    """Free radius of a rear wheel [m]. Assumed value, 9.5-16 class tyre."""
    front_wheel_width_m: Annotated[float, Field(ge=0.02, le=2)] = 0.16
    """Section width of a front tyre [m]. Assumed value, 6-12 class tyre."""
    rear_wheel_width_m: Annotated[float, Field(ge=0.02, le=2)] = 0.24
    """Section width of a rear tyre [m]. Assumed value, 9.5-16 class tyre."""
    front_wheel_mass_kg: Positive = 18.0
    """Mass of one front wheel with its tyre [kg]. Assumed value (12-25)."""
    rear_wheel_mass_kg: Positive = 45.0
    """Mass of one rear wheel with its tyre [kg]. Assumed value (30-60, no ballast)."""
    front_tyre_stiffness_n_m: Positive | None = None
    """Vertical stiffness of one front tyre [N/m]. By default from static load and radius: 1.2e5 here."""
    rear_tyre_stiffness_n_m: Positive | None = None
    """Vertical stiffness of one rear tyre [N/m]. By default from static load and radius: 1.6e5 here."""
    front_tyre_damping_n_s_m: NonNegative | None = None
    """Vertical damping of one front tyre [N s/m]. Default: 15 % of critical for the load it carries."""
    rear_tyre_damping_n_s_m: NonNegative | None = None
    """Vertical damping of one rear tyre [N s/m]. Default: 15 % of critical for the load it carries."""
    axle_pivot_limit_deg: Annotated[float, Field(gt=0, le=45)] = 10.0
    """Angle at which the oscillating front axle meets its stops, in both directions [deg]. Assumed value (8-12)."""
    steer_limit_deg: Positive = Field(45.0, le=60.0)
    """Maximum steering angle at the bicycle's virtual wheel, in both directions [deg]. Paper, section V-B."""
    antenna_height_m: Annotated[float, Field(ge=0, le=20)] = 2.0
    """Height of the GNSS antenna above level ground, straight above the rear axle [m]. Paper, section V-A."""
    hitch_behind_m: Annotated[float, Field(ge=0, le=10)] = 0.55
    """Distance of the hitch behind the rear axle [m]. Assumed value (0.45-0.7)."""
    hitch_height_m: Annotated[float, Field(ge=0, le=5)] = 0.35
    """Height of the hitch above level ground [m]. Assumed value (0.3-0.45)."""
    body: Body | None = None
    """Body that is drawn. Default: from the mass. Affects images, and the shape that hits the ground after a fall."""
    mjcf: Annotated[str, Field(min_length=1, max_length=4000), AfterValidator(printable)] | None = None
    """MuJoCo model of the machine's body, which defines sizes and masses; see docs/bodies.md for its requirements."""

    @model_validator(mode="after")
    def _size_followed(self) -> "TractorParameters":
        compact = {key: field.default for key, field in type(self).model_fields.items()}
        mass, length = self.mass_kg / compact["mass_kg"], self.wheelbase_m / compact["wheelbase_m"]
        given = "yaw_inertia_kg_m2" in self.model_fields_set
        moment = self.yaw_inertia_kg_m2 / compact["yaw_inertia_kg_m2"] if given else mass * length**2
        self.__dict__.update(self.following({"mass": mass, "length": length, "yaw_inertia": moment}).__dict__)
        taller = 2 * (self.rear_wheel_radius_m - compact["rear_wheel_radius_m"])
        fill(self, ["antenna_height_m"], compact["antenna_height_m"] + taller)
        return self

    @model_validator(mode="after")
    def _wheels_beside_each_other(self) -> "TractorParameters":
        for key in ("front_wheel_width_m", "rear_wheel_width_m"):
            if (width := getattr(self, key)) >= self.track_m:
                raise ValueError(f"{key}: must be below track_m ({self.track_m:g}), else wheels overlap, got {width:g}")
        return self

    @property
    def size(self) -> float:
        """Length divided by that of the default tractor, the scale of views and arrows in recordings [-]."""
        return self.wheelbase_m / COMPACT.wheelbase_m

    @property
    def style(self) -> Body:
        """Body that is drawn, as given or by the mass."""
        light: Body = "open" if self.mass_kg < WITH_ROLL_BAR_KG else "roll_bar"
        return self.body or ("cab" if self.mass_kg >= WITH_CAB_KG else light)

    @property
    def cg_to_rear_axle(self) -> float:
        """Distance l_r from the CG to the rear axle [m]."""
        return self.wheelbase_m * self.front_load_fraction

    @property
    def cg_to_front_axle(self) -> float:
        """Distance l_f from the CG to the front axle [m]."""
        return self.wheelbase_m - self.cg_to_rear_axle

    @property
    def steer_limit(self) -> float:
        """Maximum steering angle in both directions [rad]."""
        return radians(self.steer_limit_deg)

    def steering_for(self, curvature: float) -> float:
        """Return the steering angle on an arc of the CG without slip [rad]; a right angle where the arc is tighter than
        any.

        The CG on a circle of `curvature` kappa [1/m] has the sideslip sin(beta) = l_r kappa, and tan(delta) = L / l_r
        tan(beta).
        """
        sine = min(max(self.cg_to_rear_axle * curvature, -1.0), 1.0)
        return atan2(self.wheelbase_m * sine, self.cg_to_rear_axle * sqrt(1.0 - sine * sine))

    @property
    def tightest_radius(self) -> float:
        """Radius of the circle of the CG at the steering limit, without slip [m]."""
        return hypot(self.wheelbase_m / tan(self.steer_limit), self.cg_to_rear_axle)

    @property
    def front_axle_load(self) -> float:
        """Static load of the front axle, both wheels, level ground [N]."""
        return self.mass_kg * GRAVITY * self.front_load_fraction

    @property
    def rear_axle_load(self) -> float:
        """Static load of the rear axle, both wheels, level ground [N]."""
        return self.mass_kg * GRAVITY * (1 - self.front_load_fraction)

    @property
    def front_wheel(self) -> AxleWheel:
        """Front wheel."""
        radius, width, load = self.front_wheel_radius_m, self.front_wheel_width_m, self.front_axle_load / 2
        springs = FRONT_TYRE.under(load, radius, self.front_tyre_stiffness_n_m, self.front_tyre_damping_n_s_m)
        return AxleWheel("front", radius, width, self.front_wheel_mass_kg, load, *springs)

    @property
    def rear_wheel(self) -> AxleWheel:
        """Rear wheel."""
        radius, width, load = self.rear_wheel_radius_m, self.rear_wheel_width_m, self.rear_axle_load / 2
        springs = REAR_TYRE.under(load, radius, self.rear_tyre_stiffness_n_m, self.rear_tyre_damping_n_s_m)
        return AxleWheel("rear", radius, width, self.rear_wheel_mass_kg, load, *springs)

    @property
    def wheels(self) -> tuple[AxleWheel, AxleWheel]:
        """A front and a rear wheel."""
        return self.front_wheel, self.rear_wheel


COMPACT = TractorParameters()
"""Compact tractor of the paper, the reference size for scaling other machines."""
