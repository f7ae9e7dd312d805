"""Wire format of the AgOpenGPS family of guidance programs.

The modules convert `messages`, `wire` frames and `position` sentences to bytes and back. The module `traffic` stores
datagrams. No module opens a socket, so that links and readers of recordings can both use the modules.
"""
