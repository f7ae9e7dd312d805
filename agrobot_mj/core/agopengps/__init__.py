"""Wire format of the AgOpenGPS family of guidance programs.

The module `wire` converts `messages` to bytes and back, `position` converts position sentences, and `traffic` stores
datagrams in files. No module opens a socket, so that live links and readers of recordings can both use the modules.
"""
