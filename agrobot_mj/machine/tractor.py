"""Parameters of the tractor; the defaults describe a compact tractor of the CNH TZ25DA class.

`models/tractor.xml` contains the same numbers for the viewer of MuJoCo; a test compares them.
"""

from math import atan2, hypot, radians, sqrt, tan
from typing import Annotated, ClassVar, Literal, NamedTuple

from pydantic import AfterValidator, Field, model_validator

from agrobot_mj.core.spec import NonNegative, Positive, Spec, fill, printable
from agrobot_mj.machine.tyre_size import TyreSize, nominal_size, tyre_size

GRAVITY = 9.81  # Gravitational acceleration [m/s2], as MuJoCo's default
Body = Literal["open", "roll_bar", "cab", "robot"]
"""Appearance of a machine: seat without roll bar (`open`), seat with roll bar, cab, or deck without seat (`robot`)."""
WITH_ROLL_BAR_KG, WITH_CAB_KG = 450.0, 2500.0
"""Minimum masses of tractors that are shown with a roll bar, and with a cab, respectively [kg]. Assumed values."""


class AxleWheel(NamedTuple):
    """Properties of one wheel with its tyre. Both wheels of an axle are equal."""

    axle: str  # Axle of a tractor, "front" or "rear"; "rear" for an implement
    radius: float  # Free radius of the wheel [m]
    width: float  # Section width of the tyre [m]
    mass: float  # Mass of wheel and tyre [kg]
    load: float  # Static load of the wheel on level ground [N]
    stiffness: float  # Vertical stiffness of the tyre [N/m]
    damping: float  # Vertical damping of the tyre [N s/m]
    size: TyreSize | None = None  # Tyre dimensions given by a size code, or None if there is no code

    @property
    def deflection(self) -> float:
        """Deflection of the tyre under the static load [m]."""
        return self.load / self.stiffness


DAMPING_RATIO = 0.15
"""Vertical damping of a tyre divided by critical damping under the static load [-]. Assumed value (range 0.05-0.2)."""
AntennaPlace = Annotated[float, Field(ge=-20, le=20)]  # Horizontal distance of an antenna from the rear axle [m]
AXLES = ("front", "rear")  # Names of the axles of a tractor, with which the names of their keys begin
TyreCode = Annotated[str, Field(min_length=1, max_length=40)]  # Size code of a tyre, see `tyre_size`
PressureBar = Annotated[float, Field(ge=0.3, le=8)]  # Inflation pressure [bar]


class TractorParameters(Spec):
    """Geometry, masses and tyre sizes of the tractor (`[tractor]`).

    The default values describe the compact tractor. For other values of mass and wheelbase, default lengths scale with
    the wheelbase and default masses with the mass. The yaw inertia scales with mass times wheelbase squared, and the
    other inertias scale with the yaw inertia. The default height of the antenna above the rear wheels is constant.
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
    """Wheelbase L [m], from front to rear axle. Assumed value (range 1.4-1.6 for compact tractors)."""
    track_m: Annotated[float, Field(ge=0.3, le=6)] = 1.00
    """Track width of both axles, between the centre planes of the wheels [m]. Assumed value (range 0.9-1.1,
    adjustable)."""
    mass_kg: Annotated[float, Field(ge=50, le=100000)] = 750.0
    """Mass m of the complete tractor in working order [kg]. Assumed value (range 700-800)."""
    front_load_fraction: Annotated[float, Field(ge=0.05, le=0.95)] = 0.38
    """Fraction of the static weight carried by the front axle [-]. Assumed value (range 0.35-0.40 in the
    literature)."""
    cg_height_m: Annotated[float, Field(ge=0.05, le=5)] = 0.55
    """Height of the CG above level ground at static load [m]. Assumed value (range 0.5-0.7, with roll bar)."""
    yaw_inertia_kg_m2: Positive = 400.0
    """Yaw inertia I_z of the complete tractor about its CG [kg m2]. Assumed value (range 350-450) for a gyration radius
    of 0.73 m."""
    roll_inertia_kg_m2: Positive = 120.0
    """Roll inertia I_x of the complete tractor about its CG [kg m2]. Assumed value (range 80-160) for a gyration radius
    of 0.4 m."""
    pitch_inertia_kg_m2: Positive = 340.0
    """Pitch inertia I_y of the tractor about its CG [kg m2]. Assumed value (range 280-400; gyration radius 0.67 m)."""
    front_wheel_radius_m: Annotated[float, Field(ge=0.1, le=2)] = 0.28
    """Free radius of a front wheel [m]. Assumed value for a 6-12 tyre."""
    rear_wheel_radius_m: Annotated[float, Field(ge=0.1, le=2)] = 0.42
    """Free radius of a rear wheel [m]. Assumed value for a 9.5-16 tyre."""
    front_wheel_width_m: Annotated[float, Field(ge=0.02, le=2)] = 0.16
    """Section width of a front tyre [m]. Assumed value for a 6-12 tyre."""
    rear_wheel_width_m: Annotated[float, Field(ge=0.02, le=2)] = 0.24
    """Section width of a rear tyre [m]. Assumed value for a 9.5-16 tyre."""
    front_wheel_mass_kg: Positive = 18.0
    """Mass of one front wheel with its tyre [kg]. Assumed value (range 12-25)."""
    rear_wheel_mass_kg: Positive = 45.0
    """Mass of one rear wheel with its tyre [kg]. Assumed value (range 30-60 without ballast)."""
    front_tyre: TyreCode | None = None
    """Size code of the front tyres, such as 420/85R30, 6-12 or 26x12.00-12. The code replaces radius and width of the
    wheels, and determines section height and carcass. Default: a bias tyre with radius and width of the wheels."""
    rear_tyre: TyreCode | None = None
    """Size code of the rear tyres, such as 520/85R42; effect and default are the same as for `front_tyre`."""
    front_tyre_pressure_bar: PressureBar | None = None
    """Inflation pressure of the front tyres [bar]. Default: 0.6-2.4, so that the static load deflects the tyre by 20 %
    of the section height."""
    rear_tyre_pressure_bar: PressureBar | None = None
    """Inflation pressure of the rear tyres [bar]. Default: computed from the load as for the front tyres."""
    front_tyre_stiffness_n_m: Positive | None = None
    """Vertical stiffness of one front tyre [N/m]. Default: computed from size and pressure [Rhyne2005], 7.6e4 for the
    compact tractor."""
    rear_tyre_stiffness_n_m: Positive | None = None
    """Vertical stiffness of one rear tyre [N/m]. Default: computed from size and pressure [Rhyne2005], 9.7e4 for the
    compact tractor."""
    front_tyre_damping_n_s_m: NonNegative | None = None
    """Vertical damping of one front tyre [N s/m]. Default: 15 % of critical damping for the load on the tyre."""
    rear_tyre_damping_n_s_m: NonNegative | None = None
    """Vertical damping of one rear tyre [N s/m]. Default: 15 % of critical damping for the load on the tyre."""
    axle_pivot_limit_deg: Annotated[float, Field(gt=0, le=45)] = 10.0
    """Angle at which the oscillating front axle meets its stops [deg], in both directions. Assumed value (range
    8-12)."""
    axle_pivot_radii: Annotated[float, Field(ge=-0.5, le=1.5)] = 0.18
    """Height of the front axle's pivot above the wheel centres divided by the wheel radius [-]. Assumed value (range
    0-0.3)."""
    steer_limit_deg: Positive = Field(45.0, le=60.0)
    """Maximum angle of the virtual front wheel of the bicycle model [deg]. Paper, section V-B."""
    antenna_height_m: Annotated[float, Field(ge=0, le=20)] = 2.0
    """Height of the GNSS antenna above level ground [m]. Paper, section V-A."""
    antenna_ahead_m: AntennaPlace = 0.0
    """Distance of the GNSS antenna ahead of the rear axle [m]; typically up to 1 on a cab roof. Paper, section V-A."""
    antenna_left_m: AntennaPlace = 0.0
    """Lateral offset of the GNSS antenna [m], positive to the left; typically up to 0.5 on a cab roof. Paper, section
    V-A."""
    hitch_behind_m: Annotated[float, Field(ge=0, le=10)] = 0.55
    """Distance of the hitch behind the rear axle [m]. Assumed value (range 0.45-0.7)."""
    hitch_height_m: Annotated[float, Field(ge=0, le=5)] = 0.35
    """Height of the hitch above level ground [m]. Assumed value (range 0.3-0.45)."""
    body: Body | None = None
    """Appearance in images, and shape that touches the ground in a roll-over. Default: selected by the mass."""
    mjcf: Annotated[str, Field(min_length=1, max_length=4000), AfterValidator(printable)] | None = None
    """MJCF file of a user-defined body, which defines sizes and masses; docs/bodies.md lists the requirements."""

    @model_validator(mode="after")
    def _scale_defaults(self) -> "TractorParameters":
        compact = {key: field.default for key, field in type(self).model_fields.items()}
        mass, length = self.mass_kg / compact["mass_kg"], self.wheelbase_m / compact["wheelbase_m"]
        given = "yaw_inertia_kg_m2" in self.model_fields_set
        moment = self.yaw_inertia_kg_m2 / compact["yaw_inertia_kg_m2"] if given else mass * length**2
        self.__dict__.update(self.following({"mass": mass, "length": length, "yaw_inertia": moment}).__dict__)
        for axle in AXLES:
            self._fit_tyre(axle)
        if self.mjcf is not None and self.axle_pivot_radii != compact["axle_pivot_radii"]:
            raise ValueError("axle_pivot_radii: the body of tractor.mjcf has its own pivot; omit axle_pivot_radii")
        taller = 2 * (self.rear_wheel_radius_m - compact["rear_wheel_radius_m"])
        fill(self, ["antenna_height_m"], compact["antenna_height_m"] + taller)
        return self

    def _fit_tyre(self, axle: str) -> None:
        """Set the wheel radius and width of an axle from the tyre size code. Raises ValueError for an unusable code."""
        if (code := getattr(self, f"{axle}_tyre")) is None:
            return
        if self.mjcf is not None:
            raise ValueError(f"{axle}_tyre: the body of tractor.mjcf has its own wheels; omit {axle}_tyre")
        try:
            size = tyre_size(code)
        except ValueError as error:
            raise ValueError(f"{axle}_tyre: {error}") from None
        self.__dict__.update({f"{axle}_wheel_radius_m": size.diameter / 2, f"{axle}_wheel_width_m": size.width})

    @model_validator(mode="after")
    def _check_wheel_widths(self) -> "TractorParameters":
        for key in ("front_wheel_width_m", "rear_wheel_width_m"):
            if (width := getattr(self, key)) >= self.track_m:
                raise ValueError(
                    f"{key}: must be below track_m ({self.track_m:g}), otherwise the wheels overlap; got {width:g}"
                )
        return self

    @property
    def size(self) -> float:
        """Wheelbase divided by the wheelbase of the compact tractor [-], for scaling views and arrows in recordings."""
        return self.wheelbase_m / COMPACT.wheelbase_m

    @property
    def style(self) -> Body:
        """Appearance in images: `body` if given, or otherwise selected by the mass."""
        light: Body = "open" if self.mass_kg < WITH_ROLL_BAR_KG else "roll_bar"
        return self.body or ("cab" if self.mass_kg >= WITH_CAB_KG else light)

    @property
    def cg_to_rear_axle(self) -> float:
        """Distance l_r from the centre of gravity (CG) to the rear axle [m]."""
        return self.wheelbase_m * self.front_load_fraction

    @property
    def cg_to_front_axle(self) -> float:
        """Distance l_f from the centre of gravity (CG) to the front axle [m]."""
        return self.wheelbase_m - self.cg_to_rear_axle

    @property
    def steer_limit(self) -> float:
        """Maximum angle of the virtual front wheel in both directions [rad]."""
        return radians(self.steer_limit_deg)

    def steering_for(self, curvature: float) -> float:
        """Return the steering angle [rad] with which the CG follows an arc without tyre slip.

        On an arc of `curvature` kappa [1/m] the sideslip angle beta of the CG satisfies sin(beta) = l_r kappa, and
        tan(delta) = L / l_r tan(beta). The angle is pi/2 for arcs with a radius below l_r.
        """
        sine = min(max(self.cg_to_rear_axle * curvature, -1.0), 1.0)
        return atan2(self.wheelbase_m * sine, self.cg_to_rear_axle * sqrt(1.0 - sine * sine))

    @property
    def tightest_radius(self) -> float:
        """Turning radius of the CG at the steering limit, without tyre slip [m]."""
        return hypot(self.wheelbase_m / tan(self.steer_limit), self.cg_to_rear_axle)

    @property
    def front_axle_load(self) -> float:
        """Static load of the front axle (both wheels) on level ground [N]."""
        return self.mass_kg * GRAVITY * self.front_load_fraction

    @property
    def rear_axle_load(self) -> float:
        """Static load of the rear axle (both wheels) on level ground [N]."""
        return self.mass_kg * GRAVITY * (1 - self.front_load_fraction)

    @property
    def front_wheel(self) -> AxleWheel:
        """Properties of one front wheel with its tyre."""
        return self._wheel("front", self.front_axle_load / 2)

    @property
    def rear_wheel(self) -> AxleWheel:
        """Properties of one rear wheel with its tyre."""
        return self._wheel("rear", self.rear_axle_load / 2)

    def _wheel(self, axle: str, load: float) -> AxleWheel:
        radius, width, mass = (getattr(self, f"{axle}_wheel_{key}") for key in ("radius_m", "width_m", "mass_kg"))
        code, k, c = (getattr(self, f"{axle}_{key}") for key in ("tyre", "tyre_stiffness_n_m", "tyre_damping_n_s_m"))
        size = None if code is None else tyre_size(code)
        if k is None:
            k = self._fit(axle).stiffness(self.tyre_pressure(axle, load))
        if c is None:
            c = 2 * DAMPING_RATIO * sqrt(k * load / GRAVITY)
        return AxleWheel(axle, radius, width, mass, load, k, c, size)

    def _fit(self, axle: str) -> TyreSize:
        """Return the tyre size of an axle from its size code or, without a code, from the dimensions of the wheel."""
        code, radius, width = (getattr(self, f"{axle}_{key}") for key in ("tyre", "wheel_radius_m", "wheel_width_m"))
        return nominal_size(radius, width) if code is None else tyre_size(code)

    def tyre_pressure(self, axle: str, load: float) -> float:
        """Return the inflation pressure [bar] of the tyres of an axle: as given, or computed from the wheel `load` [N].

        `axle` is "front" or "rear".
        """
        bar: float | None = getattr(self, f"{axle}_tyre_pressure_bar")
        return self._fit(axle).pressure(load) if bar is None else bar

    @property
    def antenna(self) -> tuple[float, float, float]:
        """Position (ahead, left, up) of the GNSS antenna relative to the ground below the rear axle [m]."""
        return self.antenna_ahead_m, self.antenna_left_m, self.antenna_height_m

    @property
    def wheels(self) -> tuple[AxleWheel, AxleWheel]:
        """Properties of one front wheel and of one rear wheel."""
        return self.front_wheel, self.rear_wheel


COMPACT = TractorParameters()  # Compact tractor of the paper, the reference for scaling other machines
