"""FPFH written as the formulas read: loops over neighbours, float64 (METHOD 3)."""

import numpy as np
from reference.pair_features_slow import pair_feature


def eleven(value, low, high):
    """Number of the bin out of eleven."""
    return int(min(max(np.floor(11 * (value - low) / (high - low)), 0), 10))


def slow_spfh(points, normals, centre, members, zeros):
    """Three histograms of the pairs of a point and its neighbours, 100 / (members - 1) a pair.

    With ``zeros`` a pair without a frame has features of 0, as in Open3D.
    """
    bins = np.zeros((3, 11))
    for other in members:
        feature = (
            None if other == centre else pair_feature(points[centre], normals[centre], points[other], normals[other])
        )
        if feature is None and zeros and other != centre:
            feature = (0, 0, 0, 0)
        if feature is not None:
            theta, alpha, phi, _ = feature
            bins[0, eleven(theta, -np.pi, np.pi)] += 100 / (len(members) - 1)
            bins[1, eleven(alpha, -1, 1)] += 100 / (len(members) - 1)
            bins[2, eleven(phi, -1, 1)] += 100 / (len(members) - 1)
    return bins


def slow_fpfh(points, normals, neighborhoods, own_spfh=False):
    """(N, 33); ``neighborhoods``: the numbers of each point's neighbours, itself among them."""
    points, normals = np.float64(points), np.float64(normals)
    spfh = [slow_spfh(points, normals, row, members, own_spfh) for row, members in enumerate(neighborhoods)]
    values = np.zeros((len(points), 3, 11))
    for row, members in enumerate(neighborhoods):
        for other in members:
            square = ((points[other] - points[row]) ** 2).sum()
            if square > 0:
                values[row] += spfh[other] / square
        for part in range(3):
            total = values[row, part].sum()
            values[row, part] *= 100 / total if total > 0 else 0
        values[row] += spfh[row] if own_spfh else 0
    return values.reshape(-1, 33)
