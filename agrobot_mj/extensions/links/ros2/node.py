"""ROS 2 node of the tractor, based on rclpy: publishers of the tractor topics and a subscription to /cmd_vel."""

import re
import time
from collections.abc import Callable, Sequence
from importlib import import_module
from math import isfinite
from typing import Any, NamedTuple, Self

from agrobot_mj.core.errors import ScenarioError, import_extra
from agrobot_mj.extensions.links.ros2.content import Content
from agrobot_mj.extensions.links.ros2.definitions import TOPICS

DEPTH = 10  # Queue length of topics [messages], for slow subscribers
MOST_DOMAIN = 232  # Maximum ROS domain ID for DDS over UDP
LATCHED = "/path"  # Topic with durability TRANSIENT_LOCAL, which sends the last message to late subscribers


NAMESPACE = re.compile(r"([A-Za-z_][A-Za-z0-9_]*(/[A-Za-z_][A-Za-z0-9_]*)*)?")
"""Regular expression for a ROS namespace without its leading slash. The namespace may be empty."""
TWISTS = "geometry_msgs/Twist", "geometry_msgs/TwistStamped"  # Message types of /cmd_vel, without and with a time stamp


class VelocityMessage(NamedTuple):
    """Received velocity command."""

    speed: float  # Forward speed [m/s]
    yaw_rate: float  # Yaw rate [rad/s], left positive
    wall: float  # Arrival time from `time.perf_counter` [s]


class RosNode:
    """ROS node `tractor`, used as a context manager.

    `heard` is the number of valid commands, `refused` the number of commands with NaN or infinite values, and `last`
    the newest command.
    """

    def __init__(self, stamped: bool = False, domain: int | None = None, namespace: str = "") -> None:
        """Create the node. If `stamped`, /cmd_vel has the type TwistStamped. `namespace` applies to node and topics."""
        self.rclpy = import_extra("rclpy", "ros", "ros2")
        if domain is not None and not 0 <= domain <= MOST_DOMAIN:
            raise ScenarioError(f"--domain: must be between 0 and {MOST_DOMAIN}, got {domain}")
        if not NAMESPACE.fullmatch(namespace := namespace.strip("/")):
            raise ScenarioError(f"--namespace {namespace!r:.60}: use letters, digits and _, e.g. field/tractor_1")
        self.stamped, self.domain, self.namespace = stamped, domain, namespace
        self.heard, self.refused = 0, 0
        self.last: VelocityMessage | None = None

    def __enter__(self) -> Self:
        rclpy = self.rclpy
        quiet = ["--ros-args", "--disable-external-lib-logs"]  # no log files in the user's home folder
        signals = rclpy.signals.SignalHandlerOptions.NO  # the command itself handles Ctrl-C
        self.context = rclpy.context.Context()
        rclpy.init(args=quiet, context=self.context, domain_id=self.domain, signal_handler_options=signals)
        options = {"context": self.context, "enable_rosout": False, "start_parameter_services": False}
        self.node = rclpy.create_node("tractor", namespace=self.namespace, **options)
        self.executor = rclpy.executors.SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self.publishers = {topic: self._publisher(topic, kind) for topic, kind in TOPICS.items()}
        self.built: dict[str, tuple[Content, Any]] = {}
        requests = message_class(TWISTS[self.stamped]), full_topic(self.namespace, "cmd_vel")
        self.node.create_subscription(*requests, self._take, DEPTH)
        return self

    def __exit__(self, *_: object) -> None:
        self.executor.shutdown()
        self.node.destroy_node()
        self.rclpy.shutdown(context=self.context)

    def _publisher(self, topic: str, kind: str) -> Any:
        qos = self.rclpy.qos
        profile = qos.QoSProfile(depth=DEPTH)
        if topic == LATCHED:
            profile = qos.QoSProfile(depth=1, durability=qos.DurabilityPolicy.TRANSIENT_LOCAL)
        return self.node.create_publisher(message_class(kind), full_topic(self.namespace, topic), profile)

    def publish(self, topic: str, content: Content) -> None:
        """Publish a message on a topic. Unchanged content is published again without conversion."""
        known, message = self.built.get(topic, (None, None))
        if known is not content:
            message = message_class(TOPICS[topic])() if message is None else message
            fill(message, content)
            self.built[topic] = content, message
        self.publishers[topic].publish(message)

    def spin(self, until: float, enough: Callable[[], bool] = lambda: False) -> None:
        """Process messages until the `time.perf_counter` value `until` [s], or until `enough()` is true."""
        while not enough():
            rest = until - time.perf_counter()
            heard = self.heard
            self.executor.spin_once(timeout_sec=max(rest, 0.0))
            if rest <= 0 and self.heard == heard:
                return

    def problem(self) -> str:
        """Return the reason why no commands arrive on /cmd_vel, with a remedy, or an empty string if the reason is
        unknown."""
        found = self.node.get_publishers_info_by_topic(full_topic(self.namespace, "cmd_vel"))
        return problem_of([each.topic_type for each in found], self.stamped, self.refused)

    def _take(self, message: Any) -> None:
        twist = message.twist if self.stamped else message
        speed, yaw_rate = float(twist.linear.x), float(twist.angular.z)
        if not (isfinite(speed) and isfinite(yaw_rate)):
            self.refused += 1
            return
        self.heard += 1
        self.last = VelocityMessage(speed, yaw_rate, time.perf_counter())


def full_topic(namespace: str, name: str) -> str:
    """Return the full name of a topic or node in a namespace."""
    return "/" + "/".join(part for part in (namespace.strip("/"), name.lstrip("/")) if part)


def problem_of(types: Sequence[str], stamped: bool, refused: int) -> str:
    """Return the reason why no commands arrive on /cmd_vel, with a remedy, or an empty string if the reason is unknown.
    `types` contains the message types of the publishers, and `refused` the number of ignored commands."""
    sent = sorted({kind.replace("/msg/", "/") for kind in types})
    if sent and TWISTS[stamped] not in sent:
        fix = f"{'omit' if stamped else 'add'} --stamped" if TWISTS[not stamped] in sent else "change the publisher"
        return f"the publishers send {', '.join(sent)}, but the node expects {TWISTS[stamped]}; {fix}"
    if refused:
        return f"{refused} messages with a non-finite velocity were ignored; check the program that publishes them"
    return "" if sent else "no program publishes this topic"


def message_class(kind: str) -> Any:
    """Return the class of a message type (`nav_msgs/Odometry`). Raises `ScenarioError` for a missing package."""
    package, _, name = kind.partition("/")
    import_extra(package, "ros", "ros2")
    return getattr(import_module(f"{package}.msg"), name)


def fill(message: Any, content: Content) -> None:
    """Set the fields of a ROS message, including nested messages, from a dictionary."""
    for name, value in content.items():
        if isinstance(value, dict):
            fill(getattr(message, name), value)
        elif isinstance(value, list) and value and isinstance(value[0], dict):
            kind = message.get_fields_and_field_types()[name]  # "sequence<geometry_msgs/PoseStamped>"
            items = [message_class(kind.partition("<")[2].rstrip(">"))() for _ in value]
            for item, inner in zip(items, value, strict=True):
                fill(item, inner)
            setattr(message, name, items)
        else:
            setattr(message, name, value)
