"""Links through which external programs control the simulated tractor: AgOpenGPS programs, ROS 2 and Gymnasium."""
