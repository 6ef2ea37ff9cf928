"""Visual similarity: the light field descriptor of the patch around each point (Chen et al. 2003; METHOD 3)."""

from typing import Any, NamedTuple, final

import numpy as np
from jaxtyping import Bool, Float, Int
from numba import njit

from rm3d_plugin.descriptors.base import Descriptor
from rm3d_plugin.ops._parallel import map_blocks
from rm3d_plugin.ops.octree import Octree
from rm3d_plugin.ops.segment import segment_mean
from rm3d_plugin.ops.voxel_grid import voxel_grid
from rm3d_plugin.ops.zernike import (
    FEATURES,
    dodecahedron_views,
    draw_silhouette,
    silhouette_features,
    zernike_basis,
)
from rm3d_plugin.registry import DESCRIPTORS
from rm3d_plugin.structures import Descriptors, PointCloud

MIN_POINTS = 3
BLOCK = 16  # patches that one thread draws at a time
CHUNK = 4096  # patches whose neighbours are held in memory at a time
PRESETS: dict[str, dict[str, Any]] = {
    'indoor': {'radius': 0.25, 'spacing': 0.1},  # m; rooms at 1 to 5 cm between points
    'lidar': {'radius': 1.0, 'spacing': 0.4, 'splat': 0.15},  # m; objects on a street
}


class LightFields(NamedTuple):
    """Light field descriptors of patches.

    Attributes:
        values: (M, 10, 45) float32 in [0, 1]: for each view 35 Zernike and 10 Fourier magnitudes; zero where not valid.
        valid: (M,) bool, False where the patch has fewer than three points, or all of them at its centre.
    """

    values: Float[np.ndarray, 'patches 10 45']
    valid: Bool[np.ndarray, ' patches']


def light_fields(
    points: Float[np.ndarray, 'points 3'],
    centres: Float[np.ndarray, 'patches 3'],
    radius: float,
    resolution: int = 32,
    splat: float = 0.1,
    octree: Octree | None = None,
) -> LightFields:
    """Describe the ball around each centre by its silhouettes from the ten directions of a dodecahedron.

    Args:
        points: (N, 3) metres.
        centres: (M, 3) metres.
        radius: Of the ball, metres; becomes 1 in the images.
        resolution: Pixels along the edge of an image.
        splat: Radius at which a point is drawn, as a share of ``radius``; about the distance between points closes
            surfaces.
        octree: Over the same points, where there is one already.
    """
    tree = Octree(points) if octree is None else octree
    array = np.ascontiguousarray(points, dtype=np.float64)
    middles = np.ascontiguousarray(centres, dtype=np.float64)
    views, basis = dodecahedron_views(), zernike_basis(resolution)
    values = np.zeros((len(middles), len(views.axes), FEATURES), dtype=np.float32)
    valid = np.zeros(len(middles), dtype=np.bool_)
    for start in range(0, len(middles), CHUNK):
        found = tree.radius(middles[start : start + CHUNK], radius, ordered=False)
        rows = slice(start, start + len(found))
        apart = np.concatenate([[0], np.cumsum(found.sq_dists > 0)])[found.offsets]
        valid[rows] = (found.counts >= MIN_POINTS) & (np.diff(apart) > 0)
        frame = (views.rights, views.ups, basis, float(radius), float(splat))
        arguments = (array, middles[rows], found.offsets, found.indices, *frame, values[rows])

        def work(first: int, last: int, arguments: tuple[Any, ...] = arguments) -> None:
            _draw_block(first, last, *arguments)

        map_blocks(work, len(found), BLOCK)
    values[~valid] = 0
    return LightFields(values, valid)


def patch_centres(points: Float[np.ndarray, 'points 3'], spacing: float) -> Int[np.ndarray, ' patches']:
    """One point for each occupied cell of a grid: the nearest to the mean of the cell (ties: the lowest number)."""
    grid = voxel_grid(points, spacing)
    means = segment_mean(points, grid.point_to_voxel, len(grid.coords))
    away = ((points.astype(np.float64) - means[grid.point_to_voxel]) ** 2).sum(axis=1)
    order = np.lexsort((away, grid.point_to_voxel))
    _, first = np.unique(grid.point_to_voxel[order], return_index=True)
    return order[first].astype(np.int64)


@DESCRIPTORS.register_module()
@final
class VisualSimilarity(Descriptor):
    """Light field descriptor of every point, (N, 450): 45 numbers in [0, 1] for each of ten views.

    It is computed for one point of each cell of a grid; the other points take it from the nearest of these. The time
    goes with the number of cells (about 1 / spacing^2 on surfaces) times the points of a patch and the pixels of ten
    images. Directions are those of the scene, so rows of turned objects differ.

    Args:
        radius: Of a patch, metres (larger: more of an object is seen at once).
        spacing: Metres between described points (larger: faster, coarser).
        resolution: Pixels along the edge of an image.
        splat: Radius at which a point is drawn, as a share of ``radius`` (larger: closes sparser surfaces, rounds
            shapes off).

    Raises:
        ValueError: A number is out of range.
    """

    presets = PRESETS

    def __init__(self, radius: float = 0.25, spacing: float = 0.1, resolution: int = 32, splat: float = 0.1) -> None:
        if not (radius > 0 and spacing > 0 and splat > 0) or resolution < 8:
            raise ValueError(
                'VisualSimilarity: expected radius, spacing, splat > 0 and resolution >= 8, '
                f'got {radius}, {spacing}, {splat}, {resolution}'
            )
        self.radius = radius
        self.spacing = spacing
        self.resolution = resolution
        self.splat = splat

    def compute(self, cloud: PointCloud) -> Descriptors:
        """Describe every point of a cloud."""
        if len(cloud) == 0:
            return Descriptors(np.zeros((0, 10 * FEATURES), dtype=np.float32), np.zeros(0, dtype=np.bool_))
        centres = cloud.xyz[patch_centres(cloud.xyz, self.spacing)]
        found = light_fields(cloud.xyz, centres, self.radius, self.resolution, self.splat)
        nearest = Octree(centres).knn(cloud.xyz, 1).indices[:, 0]
        values = np.where(found.valid[:, None, None], found.values, np.float32(0)).reshape(len(centres), -1)
        return Descriptors(values[nearest], found.valid[nearest])


@njit(cache=True, nogil=True)
def _draw_block(
    start: int, stop: int, points: np.ndarray, centres: np.ndarray, offsets: np.ndarray, indices: np.ndarray,
    rights: np.ndarray, ups: np.ndarray, basis: np.ndarray, radius: float, splat: float, values: np.ndarray
) -> None:  # fmt: skip
    image = np.zeros(basis.shape[:2], dtype=np.bool_)
    features = np.zeros(values.shape[2])
    for patch in range(start, stop):
        members = indices[offsets[patch] : offsets[patch + 1]]
        if len(members) < MIN_POINTS:
            continue
        for view in range(len(rights)):
            draw_silhouette(points, members, centres[patch], rights[view], ups[view], radius, splat, image)
            silhouette_features(image, basis, features)
            values[patch, view, :] = features
