"""Nearest neighbours as tables and pairs of rows, scene by scene of a batch."""

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from rm3d_plugin.ops.octree import Octree


def nearest_within(xyz: Float[np.ndarray, 'points 3'], radius: float, count: int) -> Int[np.ndarray, 'points count']:
    """The so many nearest points of each, itself first; itself again where fewer lie within the radius.

    Args:
        xyz: Any unit.
        radius: In that unit; so what a point sees is bounded.
        count: At least 1.
    """
    points = np.array(xyz, dtype=np.float64, order='C')
    found = Octree(points).radius(points, radius, max_neighbors=count)
    out = np.repeat(np.arange(len(points))[:, None], count, axis=1)
    rows = np.repeat(np.arange(len(points)), found.counts)
    slots = np.arange(len(rows)) - np.repeat(found.offsets[:-1], found.counts)
    out[rows, slots] = found.indices
    return out


def nearest_in_batch(
    xyz: Float[Tensor, 'points 3'], batch_offsets: Int[Tensor, ' scenes_and_one'], radius: float, count: int
) -> Int[Tensor, 'points count']:
    """:func:`nearest_within` of each scene, as rows of the batch."""
    bounds, places = batch_offsets.tolist(), xyz.detach().cpu().numpy()
    parts = [
        torch.from_numpy(nearest_within(places[start:stop], radius, count)) + start
        for start, stop in zip(bounds, bounds[1:], strict=False)
    ]
    return torch.cat(parts).to(xyz.device)


def neighbor_pairs(
    xyz: Float[Tensor, 'points 3'], batch_offsets: Int[Tensor, ' scenes_and_one'], neighbors: int
) -> Int[Tensor, 'edges 2']:
    """Pairs i < j of which one is among the other's nearest points, each once, sorted; scenes are not joined.

    Args:
        xyz: Any unit.
        batch_offsets: Rows of the scenes.
        neighbors: Nearest points that each is joined to, at any distance.
    """
    bounds, places = batch_offsets.tolist(), xyz.detach().cpu().numpy().astype(np.float64)
    parts = [np.zeros((0, 2), dtype=np.int64)]
    for start, stop in zip(bounds, bounds[1:], strict=False):
        near = Octree(places[start:stop]).knn(places[start:stop], neighbors + 1).indices.astype(np.int64)
        rows = np.broadcast_to(np.arange(stop - start)[:, None], near.shape)
        kept = (near >= 0) & (near != rows)
        parts.append(np.unique(np.sort(np.stack([rows[kept], near[kept]], axis=1), axis=1), axis=0) + start)
    return torch.from_numpy(np.concatenate(parts)).to(xyz.device)
