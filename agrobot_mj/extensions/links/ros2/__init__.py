"""ROS 2: the tractor as a robot with topics, live over rclpy or as the MCAP file of a run.

`content` contains the data of one tick, live or from a log, and builds its messages as plain data of the types in
`definitions`. `node` sends the messages over rclpy (the only importer), `profile` restricts the traffic to this
computer, `session` implements `agrobot-mj ros2`, `bag` writes MCAP without ROS.
"""
