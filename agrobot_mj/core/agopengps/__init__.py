"""Wire format of the AgOpenGPS family: `wire` frames, `messages`, `position` sentences, `traffic` their record.

Bytes to messages and back, without sockets: links speak it, readers of recordings read it.
"""
