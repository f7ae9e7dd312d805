"""AgOpenGPS link: an unmodified guidance program controls the tractor over UDP.

The tractor acts as steer module, GNSS board and IMU board with the messages of AgIO + AgOpenGPS, QtAgIO + QtAgOpenGPS
and AgOpenWeb (`core.agopengps`). Modules: `board` simulates the steer module, `udp` provides sockets, `channels` paces
the exchange, `session` executes one run with its position sentences, `link` implements the command.
"""
