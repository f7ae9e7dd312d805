"""Output of commands on stderr without parts that depend on the clock."""

import re

PROGRESS = re.compile(r"^.*: [\d,]+ done(, \d+ failed)?(, \S+ \S+ (left|in all)| after \S+ \S+)?\n", re.MULTILINE)


def without_progress(text):
    """The text without lines of progress, which come about once a second."""
    return PROGRESS.sub("", text)
