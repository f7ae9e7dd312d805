"""Wire format of the AgOpenGPS family of guidance programs.

The modules convert `messages`, `wire` frames and `position` sentences to bytes and back, and store `traffic` records.
They open no sockets, so that links and readers of recordings can both use them.
"""
