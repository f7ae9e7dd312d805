"""AgOpenGPS link: the tractor as steer module, GNSS and IMU board on UDP, driven by an unmodified guidance program.

Speaks what the boards of that family speak (AgIO + AgOpenGPS, QtAgIO + QtAgOpenGPS, AgOpenWeb): `wire` frames,
`messages` in both directions, `board` the steer module, `position` the receiver's sentences, `udp` sockets and
pacing, `traffic` the record of every datagram, `session` the run, `link` the command, `host` a small guidance program
for tests.
"""
