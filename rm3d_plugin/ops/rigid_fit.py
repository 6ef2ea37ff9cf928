"""The rigid motion between matched points: by least squares, and robustly by RANSAC."""

import numpy as np
from jaxtyping import Bool, Float, Int

TRIALS = 20000  # triples that RANSAC draws
EDGE_RATIO = 0.9  # sides of a triple may differ by a tenth; Choi et al., CVPR 2015
CHUNK = 1 << 18  # matches that are tried at a time, over all motions
REFITS = 5  # least squares over the inliers, until they stay the same


def move(motion: Float[np.ndarray, '*batch 4 4'], xyz: Float[np.ndarray, 'points 3']) -> np.ndarray:
    """Points (metres) after a rigid motion; (P, 3), or (..., P, 3) of a batch of motions."""
    return xyz @ np.swapaxes(motion[..., :3, :3], -1, -2) + motion[..., None, :3, 3]


def rigid_fit(
    source: Float[np.ndarray, '*batch points 3'], target: Float[np.ndarray, '*batch points 3']
) -> Float[np.ndarray, '*batch 4 4']:
    """The rotation and translation that take source to target with the least squared error (Kabsch 1976).

    Args:
        source: Three or more points each, metres; where they lie on a line the turn about it is arbitrary.
        target: Their partners.

    Raises:
        ValueError: The shapes differ, or there are fewer than three points.

    >>> xyz = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    >>> rigid_fit(xyz, xyz + [0, 0, 2])[:3, 3].round(6)
    array([0., 0., 2.])
    """
    if source.shape != target.shape or source.shape[-2:-1] < (3,) or source.shape[-1] != 3:
        raise ValueError(f'rigid_fit: expected two arrays (..., 3 or more, 3), got {source.shape} and {target.shape}')
    before, after = source.mean(axis=-2, keepdims=True), target.mean(axis=-2, keepdims=True)
    left, _, right = np.linalg.svd(np.swapaxes(source - before, -1, -2) @ (target - after))
    flip = np.ones((*source.shape[:-2], 3))
    flip[..., 2] = np.sign(np.linalg.det(left @ right))  # no mirror
    rotation = np.swapaxes(left * flip[..., None, :] @ right, -1, -2)
    motion = np.zeros((*source.shape[:-2], 4, 4))
    motion[..., :3, :3], motion[..., 3, 3] = rotation, 1.0
    motion[..., :3, 3] = (after - before @ np.swapaxes(rotation, -1, -2))[..., 0, :]
    return motion


def ransac_rigid(
    source: Float[np.ndarray, 'matches 3'],
    target: Float[np.ndarray, 'matches 3'],
    within: float,
    rng: np.random.Generator,
    trials: int = TRIALS,
) -> Float[np.ndarray, '4 4']:
    """The motion under which the most matches come within a distance, refined on these (Fischler and Bolles 1981).

    Triples whose sides differ by more than a tenth are dropped before they are fitted. Ties go to the first triple.

    Args:
        source: Three matches or more, metres.
        target: What each is matched with; most may be wrong.
        within: Metres between a moved point and its partner that count as an inlier.
        rng: Draws the triples.
        trials: How many.

    Returns:
        The motion; where no triple can be used, the least-squares fit of all matches.

    Raises:
        ValueError: There are fewer than three matches, or a number is out of range.
    """
    if len(source) < 3 or not within > 0 or trials < 1:
        raise ValueError(
            f'ransac_rigid: expected 3 matches or more, within > 0, trials >= 1; got {len(source)}, {within}, {trials}'
        )
    triples = _usable(source, target, rng.integers(0, len(source), (trials, 3)))
    if not len(triples):
        return rigid_fit(source, target)
    motions = rigid_fit(source[triples], target[triples])
    step = max(1, CHUNK // len(source))
    counts = [
        _inliers(motions[at : at + step], source, target, within).sum(axis=-1) for at in range(0, len(motions), step)
    ]
    return _refined(motions[np.concatenate(counts).argmax()], source, target, within)


def _usable(
    source: Float[np.ndarray, 'matches 3'], target: Float[np.ndarray, 'matches 3'], triples: Int[np.ndarray, 'trials 3']
) -> Int[np.ndarray, 'kept 3']:
    """Triples of three places whose sides have nearly equal lengths before and after."""
    sides = [
        np.linalg.norm(xyz[triples] - xyz[np.roll(triples, 1, axis=1)], axis=2).astype(np.float64)
        for xyz in (source, target)
    ]
    least, most = np.minimum(*sides), np.maximum(*sides)
    return triples[((least > EDGE_RATIO * most) & (least > 0)).all(axis=1)]


def _inliers(
    motions: Float[np.ndarray, '*batch 4 4'],
    source: Float[np.ndarray, 'matches 3'],
    target: Float[np.ndarray, 'matches 3'],
    within: float,
) -> Bool[np.ndarray, '*batch matches']:
    return np.asarray(((move(motions, source) - target) ** 2).sum(axis=-1) <= within**2)


def _refined(
    motion: Float[np.ndarray, '4 4'],
    source: Float[np.ndarray, 'matches 3'],
    target: Float[np.ndarray, 'matches 3'],
    within: float,
) -> Float[np.ndarray, '4 4']:
    for _ in range(REFITS):
        inliers = _inliers(motion, source, target, within)
        if inliers.sum() < 3:
            break
        motion = rigid_fit(source[inliers], target[inliers])
        if (inliers == _inliers(motion, source, target, within)).all():
            break
    return motion
