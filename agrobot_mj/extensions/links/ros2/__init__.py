"""ROS 2 link: the tractor as a robot with topics, live over rclpy or in an MCAP file written from a run.

`content` builds the messages of one tick, live or from a log, as plain data of the types in `definitions`. `node`
publishes the messages with rclpy and is the only module that imports rclpy. `profile` restricts the traffic to this
computer. `session` implements `agrobot-mj ros2`. `bag` writes MCAP files without ROS.
"""
