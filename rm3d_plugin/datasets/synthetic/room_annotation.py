"""How people annotate a scanned room: they colour segments of the mesh, not points, and leave pieces out.

So borders are ragged: a segment that reaches over the edge of a thing is coloured as a whole.
"""

import numpy as np
from jaxtyping import Bool, Float, Int

from rm3d_plugin.datasets.synthetic.texture import noise_field

CUT = 0.1  # m^2; people cut another thing out of a segment where it fills as much
SMALL = 0.5  # m^2; larger segments are not overlooked
PATCH = 0.45  # m; overlooked segments lie together


def cut_parts(
    segment: Int[np.ndarray, ' points'], thing: Int[np.ndarray, ' points'], things: int, least: int
) -> Int[np.ndarray, ' points']:
    """Where people cut a segment, since it plainly holds another thing too.

    Args:
        segment: Numbers from 0.
        thing: Numbers from 0.
        things: How many there are.
        least: Points; what has fewer in a segment is not cut out.

    Returns:
        0 for points whose segment stays whole or that belong to most of it, else a number for each piece cut out.
    """
    pair = segment * things + thing
    pairs, inverse, count = np.unique(pair, return_inverse=True, return_counts=True)
    main = annotate(segment, thing, things)
    cut = (count[inverse] >= least) & (thing != main)
    return np.where(cut, 1 + np.arange(len(pairs))[inverse], 0)


def annotate(
    segment: Int[np.ndarray, ' points'], thing: Int[np.ndarray, ' points'], things: int
) -> Int[np.ndarray, ' points']:
    """The thing of most points of each segment; ties to the lowest.

    Args:
        segment: Numbers from 0.
        thing: Numbers from 0.
        things: How many there are.
    """
    count = int(segment.max()) + 1
    votes = np.bincount(segment * things + thing, minlength=count * things).reshape(count, things)
    return votes.argmax(axis=1)[segment]


def overlooked(
    xyz: Float[np.ndarray, 'points 3'], segment: Int[np.ndarray, ' points'], share: float, small: int
) -> Bool[np.ndarray, ' points']:
    """Points of segments that nobody coloured: small ones in patches of the room.

    Args:
        xyz: Metres, room frame.
        segment: Numbers from 0.
        share: About the share of the small segments.
        small: Points; segments of as many or more are not overlooked.
    """
    size = np.bincount(segment)
    middle = np.stack([np.bincount(segment, weights=xyz[:, i]) for i in range(3)], axis=1) / size[:, None]
    missed = noise_field(middle, PATCH) < 0.5 + 0.45 * (share - 0.5)
    return (missed & (size < small))[segment]
