"""AgOpenGPS link: the tractor acts as steer module, GNSS board and IMU board on UDP, driven by an unmodified guidance
program.

The link uses the messages of that family (AgIO + AgOpenGPS, QtAgIO + QtAgOpenGPS, AgOpenWeb), in the format of
`core.agopengps`. `board` is the steer module, `receiver` sends the position sentences, `udp` contains the sockets,
`channels` the pacing, `session` one run, `link` the command.
"""
