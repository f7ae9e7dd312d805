"""What commands print on stderr, without what the clock decides."""

import re

PROGRESS = re.compile(r"^.*: [\d,]+ done(, \d+ failed)?(, \S+ \S+ (left|in all))?\n", re.MULTILINE)


def without_progress(text):
    """The text without lines of progress, which come about once a second."""
    return PROGRESS.sub("", text)
