"""Wire format of the AgOpenGPS family: `wire` frames, `messages`, `position` sentences, and `traffic` records.

The package converts bytes to messages and back, without sockets, for links and for readers of recordings.
"""
