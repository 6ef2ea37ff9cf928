"""Labelled scenes as learned descriptors see them: sites, and the object of each."""

from typing import Any

import numpy as np
from jaxtyping import Int

from rm3d_plugin.ops.segment import number_pairs, segment_majority
from rm3d_plugin.ops.sites import voxel_sites
from rm3d_plugin.registry import TRANSFORMS

KEPT = ('scene_id', 'index', 'num_points', 'rng', 'dataset')  # of an item; the rest is about points that are gone


def point_objects(
    semantic: Int[np.ndarray, ' points'], instance: Int[np.ndarray, ' points']
) -> Int[np.ndarray, ' points']:
    """Number of each point's object, from 0: its instance, else all of its class that has none; -1 without a label.

    >>> point_objects(np.array([0, 0, 1, 1, -1]), np.array([-1, -1, 3, 4, -1]))
    array([ 0,  0,  1,  2, -1])
    """
    out = np.full(len(semantic), -1, dtype=np.int64)
    known = semantic >= 0
    out[known] = number_pairs(semantic[known], instance[known]).number
    return out


@TRANSFORMS.register_module()
class ObjectSites:
    """The scene becomes sites (:func:`~rm3d_plugin.ops.sites.voxel_sites`); ``instance`` becomes the object of each.

    A site has the object of most of its labelled points. Comes last before PackScene; other labels are left out.

    Args:
        voxel_size: Metres; None: by the distance between the points.
    """

    def __init__(self, voxel_size: float | None = None) -> None:
        self.voxel_size = voxel_size

    def __call__(self, results: dict[str, Any]) -> dict[str, Any]:
        """Find sites and objects."""
        sites = voxel_sites(results['points'][:, :3], self.voxel_size)
        objects = point_objects(results['semantic'], results['instance'])
        first = np.unique(sites.rows, return_index=True)[1]
        kept = {name: results[name] for name in KEPT if name in results}
        return kept | {
            'points': np.concatenate([sites.places, sites.inputs], axis=1),
            'point_index': results['point_index'][first],
            'instance': segment_majority(objects, sites.rows, len(sites.places)),
        }
