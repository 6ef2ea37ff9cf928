"""Scenes with all their labels as learned descriptors see them: sites, and the class of each."""

from typing import Any

import numpy as np

from rm3d_plugin.datasets.transforms.object_sites import KEPT
from rm3d_plugin.ops.segment import segment_majority
from rm3d_plugin.ops.site_heights import upright_sites
from rm3d_plugin.registry import TRANSFORMS
from rm3d_plugin.structures.point_cloud import SceneError


@TRANSFORMS.register_module()
class AllLabels:
    """Every class of a scene, whatever a label budget allows: ``semantic``.

    For networks that learn from labelled scans and are used on others: what was trained so has seen all labels of its
    scans, and has no place in a run on these whose labels are counted. Comes first in a pipeline, of scenes that are
    read without labels; others are refused.

    Args:
        first_class: Number of the data set's first class; where several data sets teach one network, each has a block
            of numbers of its own.
    """

    def __init__(self, first_class: int = 0) -> None:
        self.first_class = first_class

    def __call__(self, results: dict[str, Any]) -> dict[str, Any]:
        """Read them.

        Raises:
            ValueError: The data set reads labels itself, of a label budget say.
            SceneError: The scene has none.
        """
        if results['dataset'].labels != 'none':
            raise ValueError(
                f"AllLabels: expected labels='none', got {results['dataset'].labels!r}: it would show what a label "
                'budget hides; take it out of the pipeline'
            )
        semantic = results['dataset'].load_truth(results['index']).semantic
        if semantic is None:
            raise SceneError(f'scene {results["scene_id"]}: has no class of its points; AllLabels needs one')
        return results | {'semantic': np.where(semantic >= 0, semantic + self.first_class, -1)}


@TRANSFORMS.register_module()
class ClassSites:
    """The scene becomes sites; ``semantic`` becomes the class of most labelled points of each.

    See :func:`~rm3d_plugin.ops.site_heights.upright_sites`. Comes last before PackScene; other labels are left out.

    Args:
        voxel_size: Metres; None: by the distance between the points.
    """

    def __init__(self, voxel_size: float | None = None) -> None:
        self.voxel_size = voxel_size

    def __call__(self, results: dict[str, Any]) -> dict[str, Any]:
        """Find sites and classes."""
        sites = upright_sites(results['points'][:, :3], self.voxel_size)
        first = np.unique(sites.rows, return_index=True)[1]
        kept = {name: results[name] for name in KEPT if name in results}
        return kept | {
            'points': np.concatenate([sites.places, sites.inputs], axis=1),
            'point_index': results['point_index'][first],
            'semantic': segment_majority(results['semantic'], sites.rows, len(sites.places)),
        }
