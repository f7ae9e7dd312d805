"""Removal of points that a tractor cannot follow: repeated points, scatter at standstill, fold-backs, and outliers.

At standstill, position noise makes a recorded track reverse its direction over short legs. Such a track is thinned with
the smallest point distance that removes these reversals. At a fold-back, the track reverses by at most FOLD_M and
continues in its previous direction; the points of the fold-back are omitted. A track that reverses otherwise contains
reverse driving and remains unchanged.
"""

import numpy as np

from agrobot_mj.core.signals import Array
from agrobot_mj.paths.track import Index

CLOSEST_M = 0.001  # Minimum distance between consecutive points [m]
SHORT_M = 1.0  # Length of a leg below which a reversal is noise [m]. Assumed value, shorter than any manoeuvre.
THINNINGS_M = (0.05, 0.1, 0.2, 0.4, 0.8)
"""Minimum point distances [m] for thinning a track, applied in this order until only lasting reversals remain."""
LASTING_M = 2.0
"""Distance over which a track reverses lastingly [m]. Assumed value, larger than scatter at standstill."""
FOLD_M = 3.0  # Maximum length of a fold-back [m]. Assumed value, shorter than the reverse segment of a turn.
MOST_FOLDS = 100  # Maximum number of fold-backs in a track
MOST_FOLDED = 0.25
"""Maximum length of all fold-backs divided by the length of the track [-]. Assumed value: a short
track that reverses over a larger part contains a manoeuvre."""
BACK = np.cos(np.radians(100.0))  # Cosine of 100 degrees [-]; a track with a larger change of direction turns back
CUSP, NOISE = np.cos(np.radians(135.0)), 6.0
"""Cosine of the minimum change of direction at a cusp (135 degrees) [-], and minimum length of the compared legs,
divided by the rms position noise [-]. Assumed values."""
OUTLYING = 3.0
"""Minimum distance of outliers from the median point, divided by the extent of the other points [-]. Assumed value."""
MOST_OUTLIERS, FEWEST_POINTS = 3, 5
"""Maximum number of outliers in a file, and minimum number of points for the detection of outliers."""


def clean(points: Array, closed: bool = False, reverses: bool = False) -> tuple[Index, list[str]]:
    """Return the indices of the kept points, shape (m,), and sentences that describe the removed points.

    `points` has shape (n, 2) [m]. The last point of a closed track is joined to the first point. If the file states
    that the track `reverses`, fold-backs are kept.
    """
    notes, kept = list[str](), distinct(points)
    if repeated := len(points) - len(kept):
        notes.append(f"{repeated} repeated {'point is' if repeated == 1 else 'points are'} omitted")
    folds, rest = (0, kept) if reverses or _is_noisy(points[kept]) else _without_folds(points, kept)
    if not folds and (turns := len(_turning_back(points[kept]))):
        lasting = len(_reversals(points[kept][space_out(points[kept], LASTING_M, True)]))
        most = min(lasting, len(_reversals(points[kept])) - 1)
        for distance in THINNINGS_M:
            thin = kept[space_out(points[kept], distance, closed)]
            if len(_reversals(points[thin])) <= most:
                notes.append(
                    f"the track is reduced from {len(kept)} to {len(thin)} points, {distance:g} m apart, because it "
                    f"turns back at {turns} points, which indicates noise at standstill"
                )
                kept = thin
                break
        folds, rest = (0, kept) if reverses else _without_folds(points, kept)
    if folds:
        places = "a fold-back" if folds == 1 else f"{folds} fold-backs"
        count = len(kept) - len(rest)
        omitted = "1 point is omitted" if count == 1 else f"{count} points are omitted"
        notes.append(f"{omitted} at {places} of at most {FOLD_M:g} m")
    return rest, notes


def outliers(points: Array) -> Index:
    """Return the indices of outliers, shape (k,), which are points far from all other points.

    The array is empty if there are more than MOST_OUTLIERS outliers.
    """
    found = np.zeros(len(points), dtype=bool)
    while len(points) - found.sum() >= FEWEST_POINTS:
        others = points[~found]
        middle = np.median(others, axis=0)
        distance = np.where(found, -1.0, np.hypot(*(points - middle).T))
        k = int(np.argmax(distance))
        rest = points[~found & (np.arange(len(points)) != k) & (np.hypot(*(points - points[k]).T) > CLOSEST_M)]
        extent = float(np.hypot(*np.ptp(rest, axis=0))) if len(rest) else np.inf
        if distance[k] <= OUTLYING * extent:
            break
        found |= np.hypot(*(points - points[k]).T) <= CLOSEST_M
        if found.sum() > MOST_OUTLIERS:
            return np.array([], dtype=int)
    return np.flatnonzero(found)


def distinct(points: Array) -> Index:
    """Return the indices of the points at a distance of at least CLOSEST_M from the previously kept point."""
    steps = np.hypot(*np.diff(points, axis=0).T)
    if (steps >= CLOSEST_M).all():
        return np.arange(len(points))
    return space_out(points, CLOSEST_M, False)


def space_out(points: Array, distance: float, closed: bool) -> Index:
    """Return the indices of the points at a distance of at least `distance` [m] from the previously kept point.

    For an open track and a `distance` above CLOSEST_M, the last point of the track replaces the last kept point.
    """
    rows, kept = points.tolist(), [0]
    x, y = rows[0]
    limit = distance**2
    for k, (east, north) in enumerate(rows[1:], start=1):
        if (east - x) ** 2 + (north - y) ** 2 >= limit:
            kept.append(k)
            x, y = east, north
    last = len(rows) - 1
    if not closed and kept[-1] != last and distance > CLOSEST_M and len(kept) > 1:
        kept[-1] = last
    return np.array(kept)


def cusps(points: Array, noise: float) -> Index:
    """Return the indices of the points at which a track, shape (n, 2) [m], starts or ends to drive in reverse.

    The changes of direction are computed between legs longer than the rms position noise `noise` [m]. Reversals at a
    distance of less than LASTING_M from each other, or from an end of the track, are noise at standstill. Without
    reversals between consecutive points, reversals between legs are tight bends.
    """
    if not len(_reversals(points)):
        return np.array([], dtype=int)
    thin = space_out(points, max(SHORT_M, NOISE * noise), True)
    found = [0]
    for k in _reversals(points[thin], CUSP).tolist():
        start, end = int(thin[k - 1]), int(thin[k + 1])
        found.append(start + int(np.argmax(points[start:end] @ (points[thin[k]] - points[start]))))
    gaps = np.hypot(*np.diff(points[[*found, -1]], axis=0).T)
    lasting: Index = np.array(found)[1:][np.minimum(gaps[:-1], gaps[1:]) >= LASTING_M]
    return lasting


def _turning_back(points: Array) -> Index:
    """Return the indices of the points next to a short leg at which the track reverses its direction."""
    found, lengths = _reversals(points), np.hypot(*np.diff(points, axis=0).T)
    near: Index = found[np.minimum(lengths[found], lengths[found - 1]) < SHORT_M]
    return near


def _reversals(points: Array, back: float = BACK) -> Index:
    """Return the indices of the points at which the cosine of the change of direction is below `back`."""
    legs = np.diff(points, axis=0)
    lengths = np.maximum(np.hypot(*legs.T), 1e-12)
    along = (legs[1:] * legs[:-1]).sum(axis=1) / (lengths[1:] * lengths[:-1])
    found: Index = 1 + np.flatnonzero(along < back)
    return found


def _is_noisy(points: Array) -> bool:
    """Return whether a track reverses twice within SHORT_M."""
    distances = np.cumsum(np.hypot(*np.diff(points, axis=0).T))
    return bool((np.diff(distances[_reversals(points) - 1]) < SHORT_M).any())


def _without_folds(points: Array, kept: Index) -> tuple[int, Index]:
    """Return the number of fold-backs and the indices of `kept` without fold-backs. If there are other reversals, or
    the fold-backs are a large part of the track, return 0 and `kept`."""
    rest = kept
    for count in range(MOST_FOLDS):
        left = points[rest]
        if not len(reversals := _reversals(left)):
            return (count, rest) if _length(left) >= (1 - MOST_FOLDED) * _length(points[kept]) else (0, kept)
        if (after := _after_fold(left, int(reversals[0]))) is None:
            break
        rest = np.delete(rest, slice(int(reversals[0]) + 1, after))
    return 0, kept


def _length(points: Array) -> float:
    return float(np.hypot(*np.diff(points, axis=0).T).sum())


def _after_fold(points: Array, k: int) -> int | None:
    """Return the index of the first point after the fold-back that starts at point `k`, the number of points if the
    track ends in the fold-back, or None if the reversal at `k` does not start a fold-back."""
    ahead = (points[k] - points[k - 1]) / np.hypot(*(points[k] - points[k - 1]))
    for after in range(k + 1, len(points)):
        away = points[after] - points[k]
        along, distance = float(away @ ahead), float(np.hypot(*away))
        if along > max(-BACK * distance, CLOSEST_M):
            leg = points[min(after + 1, len(points) - 1)] - points[after - 1]
            return after if float(leg @ ahead) > 0.5 * float(np.hypot(*leg)) else None
        if distance > FOLD_M:
            return None
    return len(points)
