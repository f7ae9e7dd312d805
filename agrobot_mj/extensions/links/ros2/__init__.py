"""ROS 2: the tractor as a robot with topics, live over rclpy or as an MCAP file of a run.

`content` is what one tick has to tell, live or from a log, and makes the messages of it as plain data, of the
types in `definitions`; `node` sends them over rclpy (the only importer), `profile` keeps it on this computer,
`session` is `agrobot-mj ros2`; `bag` writes MCAP without ROS.
"""
