"""AgOpenGPS link: the tractor as steer module, GNSS and IMU board on UDP, driven by an unmodified guidance program.

Speaks what the boards of that family speak (AgIO + AgOpenGPS, QtAgIO + QtAgOpenGPS, AgOpenWeb), in the format of
`core.agopengps`: `board` is the steer module, `receiver` sends the sentences, `udp` has the sockets and `channels` the
pacing, `session` is the run, `link` the command, `host` a small guidance program for tests.
"""
