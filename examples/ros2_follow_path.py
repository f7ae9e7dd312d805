"""ROS 2 controller for `agrobot-mj ros2`: pure pursuit of /path with commands on /cmd_vel.

The look-ahead distance is 2.5 m, and the speed is 1.5 m/s.
"""

from math import atan2, cos, hypot, sin

import rclpy
from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry, Path
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile

SPEED, AHEAD = 1.5, 2.5


class Follower(Node):
    """ROS 2 node that publishes a command on /cmd_vel for each message on /odometry."""

    def __init__(self) -> None:
        super().__init__("follower")
        self.points, self.place = [], 0
        self.out = self.create_publisher(Twist, "/cmd_vel", 10)
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self.create_subscription(Path, "/path", self.take, latched)
        self.create_subscription(Odometry, "/odometry", self.drive, 10)

    def take(self, path: Path) -> None:
        """Store the path points of a message on /path."""
        self.points = [(p.pose.position.x, p.pose.position.y) for p in path.poses]

    def drive(self, odometry: Odometry) -> None:
        """Publish a command that steers towards the first path point beyond the look-ahead distance."""
        if not self.points:
            return
        at, q = odometry.pose.pose.position, odometry.pose.pose.orientation
        while self.place < len(self.points) - 1 and hypot(*self.offset(self.place, at)) < AHEAD:
            self.place += 1
        (dx, dy), yaw = self.offset(self.place, at), 2 * atan2(q.z, q.w)
        command = Twist()
        command.linear.x = SPEED
        command.angular.z = SPEED * 2 * (cos(yaw) * dy - sin(yaw) * dx) / max(dx * dx + dy * dy, AHEAD**2)
        self.out.publish(command)

    def offset(self, k: int, at) -> tuple[float, float]:
        """Return the vector from the tractor position `at` to the path point `k` [m]."""
        return self.points[k][0] - at.x, self.points[k][1] - at.y


rclpy.init()
rclpy.spin(Follower())
