"""ROS 2 message types of the tractor, as text of .msg files.

A definition lists fields as `type name`. A nested type without a package name is in the same package. `full_definition`
returns a type with all nested types, as MCAP schemas require.
"""

SEPARATOR = "=" * 80
DEFINITIONS = {
    "builtin_interfaces/Time": "int32 sec\nuint32 nanosec",
    "std_msgs/Header": "builtin_interfaces/Time stamp\nstring frame_id",
    "rosgraph_msgs/Clock": "builtin_interfaces/Time clock",
    "geometry_msgs/Vector3": "float64 x\nfloat64 y\nfloat64 z",
    "geometry_msgs/Point": "float64 x\nfloat64 y\nfloat64 z",
    "geometry_msgs/Quaternion": "float64 x 0\nfloat64 y 0\nfloat64 z 0\nfloat64 w 1",
    "geometry_msgs/Pose": "geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation",
    "geometry_msgs/PoseStamped": "std_msgs/Header header\ngeometry_msgs/Pose pose",
    "geometry_msgs/PoseWithCovariance": "geometry_msgs/Pose pose\nfloat64[36] covariance",
    "geometry_msgs/Twist": "geometry_msgs/Vector3 linear\ngeometry_msgs/Vector3 angular",
    "geometry_msgs/TwistWithCovariance": "geometry_msgs/Twist twist\nfloat64[36] covariance",
    "geometry_msgs/Transform": "geometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation",
    "geometry_msgs/TransformStamped": (
        "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/Transform transform"
    ),
    "tf2_msgs/TFMessage": "geometry_msgs/TransformStamped[] transforms",
    "nav_msgs/Odometry": (
        "std_msgs/Header header\nstring child_frame_id\n"
        "geometry_msgs/PoseWithCovariance pose\ngeometry_msgs/TwistWithCovariance twist"
    ),
    "nav_msgs/Path": "std_msgs/Header header\ngeometry_msgs/PoseStamped[] poses",
    "sensor_msgs/NavSatStatus": (
        "int8 STATUS_NO_FIX=-1\nint8 STATUS_FIX=0\nint8 STATUS_SBAS_FIX=1\nint8 STATUS_GBAS_FIX=2\nint8 status\n"
        "uint16 SERVICE_GPS=1\nuint16 SERVICE_GLONASS=2\nuint16 SERVICE_COMPASS=4\nuint16 SERVICE_GALILEO=8\n"
        "uint16 service"
    ),
    "sensor_msgs/NavSatFix": (
        "std_msgs/Header header\nsensor_msgs/NavSatStatus status\nfloat64 latitude\nfloat64 longitude\n"
        "float64 altitude\nfloat64[9] position_covariance\nuint8 COVARIANCE_TYPE_UNKNOWN=0\n"
        "uint8 COVARIANCE_TYPE_APPROXIMATED=1\nuint8 COVARIANCE_TYPE_DIAGONAL_KNOWN=2\n"
        "uint8 COVARIANCE_TYPE_KNOWN=3\nuint8 position_covariance_type"
    ),
    "sensor_msgs/Imu": (
        "std_msgs/Header header\ngeometry_msgs/Quaternion orientation\nfloat64[9] orientation_covariance\n"
        "geometry_msgs/Vector3 angular_velocity\nfloat64[9] angular_velocity_covariance\n"
        "geometry_msgs/Vector3 linear_acceleration\nfloat64[9] linear_acceleration_covariance"
    ),
    "sensor_msgs/JointState": (
        "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort"
    ),
}
TOPICS = {
    "/fix": "sensor_msgs/NavSatFix",
    "/imu/data": "sensor_msgs/Imu",
    "/joint_states": "sensor_msgs/JointState",
    "/odometry": "nav_msgs/Odometry",
    "/ground_truth/odom": "nav_msgs/Odometry",
    "/path": "nav_msgs/Path",
    "/clock": "rosgraph_msgs/Clock",
}
"""Message types of a live tractor, by topic."""
RECORDED = {**TOPICS, "/cmd_vel": "geometry_msgs/Twist", **dict.fromkeys(("/tf", "/tf_static"), "tf2_msgs/TFMessage")}
"""Message types in an MCAP file, by topic. The package tf2_msgs is not required for writing a file."""


def full_name(kind: str) -> str:
    """Return the full name of a message type: `nav_msgs/msg/Odometry` for `nav_msgs/Odometry`."""
    package, _, name = kind.partition("/")
    return f"{package}/msg/{name}"


def full_definition(kind: str) -> str:
    """Return the definition of a message type, followed by the definition of each nested type."""
    needed = list(dict.fromkeys(_inside(kind)))
    return "\n".join([DEFINITIONS[kind], *(f"{SEPARATOR}\nMSG: {name}\n{DEFINITIONS[name]}" for name in needed)]) + "\n"


def _inside(kind: str) -> list[str]:
    found = []
    for line in DEFINITIONS[kind].split("\n"):
        name = line.split(" ")[0].partition("[")[0]
        if name in DEFINITIONS:
            found += [name, *_inside(name)]
    return found
