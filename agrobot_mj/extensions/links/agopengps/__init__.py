"""AgOpenGPS link: an unmodified guidance program (the host) controls the tractor over UDP.

The tractor acts as steer module, GNSS board and IMU board with the messages of AgIO + AgOpenGPS, QtAgIO + QtAgOpenGPS
and AgOpenWeb (`core.agopengps`). Modules: `board` simulates the steer module; `udp` contains the sockets; `channels`
determines the pace of the link cycles; `session` runs the scenario and sends positions; `link` implements the command.
"""
