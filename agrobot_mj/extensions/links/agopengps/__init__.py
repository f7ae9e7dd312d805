"""AgOpenGPS link: an unmodified guidance program controls the tractor over UDP.

The tractor acts as steer module, GNSS board and IMU board with the messages of AgIO + AgOpenGPS, QtAgIO + QtAgOpenGPS
and AgOpenWeb (`core.agopengps`). `board` is the steer module, `udp` contains the sockets, `channels` the pacing,
`session` one run and its position sentences, `link` the command.
"""
