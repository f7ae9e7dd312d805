"""Wire format of the AgOpenGPS family of guidance programs.

The module `wire` encodes and decodes `messages`, `position` does so for position sentences, and `traffic` stores
datagrams. No module opens a socket, so that live links and readers of recordings can both use the modules.
"""
