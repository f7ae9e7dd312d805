"""Common words for keys and kinds that have other names, for searches and suggestions."""

import re

SYNONYMS = {
    "weight": ("mass",),
    "slope": ("grade",),
    "gradient": ("grade",),
    "incline": ("grade",),
    "angle": ("grade",),
    "gain": ("kp", "kd", "ki"),
    "velocity": ("speed",),
    "grip": ("mu",),
    "adhesion": ("mu",),
    "tire": ("tyre",),
    "gps": ("gnss",),
    "rtk": ("gnss",),
    "filter": ("estimator",),
    "law": ("guidance",),
    "lag": ("delay", "latency"),
    "delay": ("latency",),
    "noise": ("sigma",),
    "throttle": ("pedal",),
    "deadband": ("dead_band",),
    "zone": ("band",),
    "trailer": ("drawn", "hitch"),
    "plough": ("drawn", "draught"),
    "plow": ("drawn", "draught"),
    "mud": ("soil",),
    "heading": ("yaw",),
    "time": ("duration",),
}
"""Parts of names of keys and kinds by common word."""
SHORT = 3
"""Maximum number of letters of a search word that matches complete words only, such as `mu`."""


def alternatives(word: str) -> tuple[str, ...]:
    """Return a word in lower case and its synonyms, also for a plural."""
    word = word.lower()
    return word, *SYNONYMS.get(word, SYNONYMS.get(word.removesuffix("s"), ()))


def named_by(words: list[str], text: str) -> bool:
    """Return whether a text contains the joined words, or a synonym of each word as a complete word."""
    if "".join(words).lower() in re.sub(r"[\s_]", "", text.lower()):
        return True
    parts = set(re.split(r"[^a-z0-9]+", text.lower()))
    return all(any(_contains(parts, text.lower(), each) for each in alternatives(word)) for word in words)


def _contains(parts: set[str], text: str, word: str) -> bool:
    """Return whether `word` is one of the words of a text or, if it is an expression or long, part of it."""
    return word in parts or (len(word) > SHORT and word in text)


def is_synonym(name: str, known: str) -> bool:
    """Return whether a known name starts with a synonym of the first word of another name."""
    return any(f"{known}_".startswith(f"{other}_") for other in alternatives(name.partition("_")[0])[1:])
