"""Where a scan was seen from, where nobody knows."""

import numpy as np
from jaxtyping import Float


def virtual_viewpoint(xyz: Float[np.ndarray, 'points 3']) -> Float[np.ndarray, '3']:
    """A viewpoint for a cloud whose sensor is not known (metres); it moves with the cloud under any rigid motion.

    It lies off the mean along the direction in which the cloud is thinnest, on the side of the longer tail, as far as
    the cloud's standard deviation in all directions together: a plane is seen from one side, a room from its middle.
    """
    if len(xyz) == 0:
        return np.zeros(3)
    points = xyz.astype(np.float64)
    mean = points.mean(axis=0)
    centred = points - mean
    variances, axes = np.linalg.eigh(centred.T @ centred / len(points))
    along = centred @ axes[:, 0]
    side = 1.0 if (along**3).sum() >= 0 else -1.0
    return mean + side * np.sqrt(max(variances.sum(), 0.0)) * axes[:, 0]
