"""Reader for ROS 2 bags in MCAP: fixes, inertial units, odometry, joints and steering reports, by message type.

Times are the stamps in message headers, if present. `Odometry` gives position, heading and speed along the heading.
`Imu` gives only the yaw rate, because the origin of its heading is arbitrary. `JointState` gives the mean angle of the
joints with "steer" in their names. Topics with "truth" in their names are ignored, because they contain simulated
truth. A truncated bag is read up to its end. Requires the extra `mcap`.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from math import atan2
from pathlib import Path
from typing import Any, Literal

from agrobot_mj.core.errors import ScenarioError, import_extra
from agrobot_mj.core.table_columns import FieldLogError
from agrobot_mj.extensions.logs.readers.base import Head, LogReader, ReadLog, Samples

MAGIC, SQLITE = b"\x89MCAP0\r\n", b"SQLite format 3\0"
MOST_RECORD_BYTES = 256_000_000  # Maximum size of a record, and of a chunk after unpacking [bytes]
FIX_QUALITY = {-1: 0, 0: 1, 1: 2, 2: 4}
"""GGA quality for each NavSatFix status: no fix, autonomous, satellite-based (SBAS), ground-based (GBAS)."""


def _fix(m: Any) -> dict[str, float]:
    quality = FIX_QUALITY.get(m.status.status, 0)
    return {"quality": quality} | ({"latitude": m.latitude, "longitude": m.longitude} if quality else {})


def _imu(m: Any) -> dict[str, float]:
    measured = m.angular_velocity_covariance[0] != -1
    return {"yaw_rate": m.angular_velocity.z} if measured else {}


def _odometry(m: Any) -> dict[str, float]:
    place, q = m.pose.pose.position, m.pose.pose.orientation
    yaw = atan2(2 * (q.w * q.z + q.x * q.y), 1 - 2 * (q.y * q.y + q.z * q.z))
    return {"east": place.x, "north": place.y, "heading": yaw, "speed": m.twist.twist.linear.x}


def _joints(m: Any) -> dict[str, float]:
    angles = [angle for name, angle in zip(m.name, m.position, strict=False) if "steer" in name.lower()]
    return {"steer": sum(angles) / len(angles)} if angles else {}


CONTENT: dict[str, Callable[[Any], dict[str, float]]] = {
    "sensor_msgs/msg/NavSatFix": _fix,
    "sensor_msgs/msg/Imu": _imu,
    "nav_msgs/msg/Odometry": _odometry,
    "sensor_msgs/msg/JointState": _joints,
    "ackermann_msgs/msg/AckermannDriveStamped": lambda m: {"steer_demand": m.drive.steering_angle},
    "autoware_vehicle_msgs/msg/SteeringReport": lambda m: {"steer": m.steering_tire_angle},
    "autoware_vehicle_msgs/msg/VelocityReport": lambda m: {"speed": m.longitudinal_velocity},
}
"""Functions that convert messages to quantities, by message type."""


class Ros2Bag(LogReader):
    """Reader for ROS 2 bags in MCAP: position, speed, yaw rate, heading, wheel angle."""

    kind: Literal["mcap"] = "mcap"

    def recognises(self, head: Head) -> bool:
        """Return whether the path is an MCAP file, a folder with one MCAP file, or a bag in SQLite format."""
        return head.data.startswith((MAGIC, SQLITE)) or len(list(head.path.glob("*.mcap"))) == 1

    def read(self, path: Path) -> ReadLog:
        """Return the quantities in all messages of a type in `CONTENT`, regardless of their topics."""
        file = next(path.glob("*.mcap")) if path.is_dir() else path
        samples, notes, count = Samples(path, ordered=False), list[str](), 0
        try:
            for topic, t, values in _messages(file):
                samples.add(t, topic, **values)
                count += 1
        except ScenarioError:
            raise
        except Exception as error:  # the library does not specify its exceptions for damaged files
            reason = (str(error).splitlines() or [""])[0][:100]
            notes.append(f"{file.name} is damaged after {count} messages ({type(error).__name__} {reason})")
        return samples.log(f"messages of a known type ({', '.join(CONTENT)})", *notes)


def _messages(file: Path) -> Iterator[tuple[str, float, dict[str, float]]]:
    """Yield topic, time [s] and quantities of each message of a known type."""
    stream_reader: Any = import_extra("mcap.stream_reader", "mcap", "reading a ROS 2 bag")
    decoders: Any = import_extra("mcap_ros2.decoder", "mcap", "reading a ROS 2 bag").DecoderFactory()
    records: Any = import_extra("mcap.records", "mcap", "reading a ROS 2 bag")
    schemas, channels = dict[int, Any](), dict[int, Any]()
    with file.open("rb") as stream:
        if stream.read(len(SQLITE)) == SQLITE:
            raise FieldLogError(f"{file.name}: the bag is in SQLite format; convert it to MCAP with: ros2 bag convert")
        stream.seek(0)
        for record in _records(stream_reader, records, stream, file.name):
            if isinstance(record, records.Schema):
                schemas[record.id] = record
            elif isinstance(record, records.Channel):
                channels[record.id] = record
            elif isinstance(record, records.Message):
                channel = channels[record.channel_id]
                schema = schemas.get(channel.schema_id)
                if schema is None or schema.name not in CONTENT or "truth" in channel.topic.lower():
                    continue
                if (decode := decoders.decoder_for(channel.message_encoding, schema)) is None:
                    continue
                message = decode(record.data)
                yield channel.topic, _stamp(message) or record.log_time * 1e-9, CONTENT[schema.name](message)


def _records(library: Any, records: Any, stream: Any, name: str) -> Iterator[Any]:
    """Yield the records of a file and of its chunks. A chunk has at most `MOST_RECORD_BYTES` after unpacking."""
    reader = library.StreamReader(stream, emit_chunks=True, record_size_limit=MOST_RECORD_BYTES)
    for record in reader.records:
        if isinstance(record, records.Chunk):
            yield from library.breakup_chunk(replace(record, compression="", data=_decompress(record, name)))
        else:
            yield record


def _decompress(chunk: Any, name: str) -> bytes:
    if chunk.compression == "zstd":
        zstandard: Any = import_extra("zstandard", "mcap", "reading a ROS 2 bag")
        data = zstandard.ZstdDecompressor().stream_reader(chunk.data).read(MOST_RECORD_BYTES + 1)
    elif chunk.compression == "lz4":
        lz4: Any = import_extra("lz4.frame", "mcap", "reading a ROS 2 bag")
        data = lz4.LZ4FrameDecompressor().decompress(chunk.data, max_length=MOST_RECORD_BYTES + 1)
    else:
        data = chunk.data
    if len(data) > MOST_RECORD_BYTES:
        raise FieldLogError(
            f"{name}: a chunk exceeds {MOST_RECORD_BYTES / 1e6:g} MB when unpacked; write the bag with smaller chunks"
        )
    return bytes(data)


def _stamp(message: Any) -> float:
    """Return the time stamp in the header of a message [s], or 0 if there is no header."""
    stamp = getattr(getattr(message, "header", message), "stamp", None)
    return stamp.sec + stamp.nanosec * 1e-9 if stamp is not None else 0.0
