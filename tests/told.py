"""Messages of commands on stderr, without parts that depend on the clock."""

import re

PROGRESS = re.compile(r"^.*: [\d,]+ done(, \d+ failed)?(, \S+ \S+ (left|in all)| after \S+ \S+)?\n", re.MULTILINE)


def without_progress(text):
    """Return the text without the progress lines, which are printed about once a second."""
    return PROGRESS.sub("", text)
