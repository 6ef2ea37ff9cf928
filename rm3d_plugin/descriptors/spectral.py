"""What heat and wave kernel signatures share: the spectrum of a surface and the way back to points (METHOD 3)."""

from abc import abstractmethod
from dataclasses import dataclass
from typing import Any, NamedTuple, final

import numpy as np
import scipy.sparse
import scipy.sparse.csgraph
from jaxtyping import Bool, Float, Int

from rm3d_plugin.descriptors.base import Descriptor
from rm3d_plugin.ops._blas import one_blas_thread
from rm3d_plugin.ops.laplacian import Eigenpairs, connected_parts, lowest_eigenpairs, point_laplacian
from rm3d_plugin.ops.octree import Octree
from rm3d_plugin.ops.voxel_downsample import voxel_downsample_points
from rm3d_plugin.structures import Descriptors, PointCloud

PRESETS: dict[str, dict[str, Any]] = {
    'indoor': {'spacing': 0.04},  # m; METHOD 3: 3 to 5 cm
    'lidar': {'spacing': 0.2, 'link': 0.8},  # m; the rings of a 64-beam scanner are so far apart at some 40 m
}
NEAR = 4  # points of the sub-cloud that a point takes its values from
BLOCK = 8192  # points described at a time: bounds memory
CONNECTED = 1e-9  # of the largest eigenvalue: a second one below it belongs to a surface in two pieces


@dataclass(frozen=True)
class SpectrumSettings:
    """How a scene becomes surfaces with a spectrum.

    Attributes:
        spacing: Metres between points of the sub-cloud (smaller: finer detail, cost grows with the points).
        link: Metres; points of the sub-cloud so near are connected. None: twice the spacing.
        eigenpairs: Per component (larger: finer detail, slower).
        n_neighbors: Nearest points that the Laplacian triangulates.
        mollify: Relative to the mean edge; how much degenerate triangles are widened.
        min_points: Components with fewer points of the sub-cloud are not described.

    Raises:
        ValueError: A number is out of range.
    """

    spacing: float = 0.04
    link: float | None = None
    eigenpairs: int = 64
    n_neighbors: int = 30
    mollify: float = 1e-5
    min_points: int = 64

    def __post_init__(self) -> None:
        if not self.spacing > 0 or (self.link is not None and not self.link >= self.spacing):
            raise ValueError(f'spacing, link: expected 0 < spacing <= link (metres), got {self.spacing}, {self.link}')
        if self.eigenpairs < 3 or self.n_neighbors < 3 or not self.mollify >= 0:
            raise ValueError(
                'eigenpairs, n_neighbors, mollify: expected >= 3, >= 3, >= 0, '
                f'got {self.eigenpairs}, {self.n_neighbors}, {self.mollify}'
            )
        if self.min_points <= max(self.n_neighbors, 3):
            raise ValueError(f'min_points: expected more than n_neighbors = {self.n_neighbors}, got {self.min_points}')


class SurfaceSpectrum(NamedTuple):
    """One connected surface of the sub-cloud.

    Attributes:
        rows: (S,) numbers within the sub-cloud, ascending.
        pairs: Its lowest eigenpairs; the first is the constant function.
    """

    rows: Int[np.ndarray, ' samples']
    pairs: Eigenpairs


def surface_spectra(samples: Float[np.ndarray, 'samples 3'], settings: SpectrumSettings) -> list[SurfaceSpectrum]:
    """Spectra of the connected surfaces of a sub-cloud, those that are large enough and no mere line.

    Points within ``link`` are connected; a part that the Laplacian itself divides is divided.

    Args:
        samples: (S, 3) metres, no two in one place.
        settings: See there.
    """
    spectra: list[SurfaceSpectrum] = []
    for rows in _linked(samples, 2.0 * settings.spacing if settings.link is None else settings.link):
        if len(rows) < settings.min_points:
            continue
        operator = point_laplacian(samples[rows], settings.n_neighbors, settings.mollify)
        for part, laplacian in [] if operator is None else connected_parts(operator):
            if len(part) >= settings.min_points:
                pairs = lowest_eigenpairs(laplacian, settings.eigenpairs)
                if pairs.values[1] > CONNECTED * pairs.values[-1]:
                    spectra.append(SurfaceSpectrum(rows[part], pairs))
    return spectra


def _linked(samples: Float[np.ndarray, 'samples 3'], link: float) -> list[Int[np.ndarray, ' _rows']]:
    """Rows of each component of points that links join, in the order of their first points."""
    if len(samples) == 0:
        return []
    found = Octree(samples).radius(samples, link, ordered=False)
    graph = scipy.sparse.csr_matrix(
        (np.ones(len(found.indices), dtype=np.int8), found.indices, found.offsets), shape=(len(samples),) * 2
    )
    _, labels = scipy.sparse.csgraph.connected_components(graph, directed=False)
    order = np.argsort(labels, kind='stable')
    parts = np.split(order, np.flatnonzero(np.diff(labels[order])) + 1)
    return sorted(parts, key=lambda rows: int(rows[0]))


def spread_to_points(
    points: Float[np.ndarray, 'points 3'],
    samples: Float[np.ndarray, 'samples 3'],
    surface: Int[np.ndarray, ' samples'],
    values: Float[np.ndarray, 'samples features'],
) -> tuple[Float[np.ndarray, 'points features'], Bool[np.ndarray, ' points']]:
    """Values of points from the nearest samples of the nearest sample's surface, weighted by inverse squared distance.

    Args:
        points: (N, 3) metres.
        samples: (S, 3) metres.
        surface: (S,) number of the surface, -1 where a sample has no values.
        values: (S, F).

    Returns:
        float32 values and validity, one row a point; not valid where the nearest sample has no values.
    """
    out = np.zeros((len(points), values.shape[1]), dtype=np.float32)
    valid = np.zeros(len(points), dtype=np.bool_)
    tree = Octree(samples)
    for start in range(0, len(points) if len(samples) else 0, BLOCK):
        rows = slice(start, start + BLOCK)
        near = tree.knn(points[rows], min(NEAR, len(samples)))
        own = surface[near.indices[:, :1]]
        weights = np.where(surface[near.indices] == own, 1.0 / np.maximum(near.sq_dists, 1e-12), 0.0)
        weights /= weights.sum(axis=1, keepdims=True)
        total = np.zeros((len(near.indices), values.shape[1]))
        for column in range(near.indices.shape[1]):
            total += weights[:, column, None] * values[near.indices[:, column]]
        valid[rows] = own[:, 0] >= 0
        out[rows] = np.where(valid[rows][:, None], total, 0.0)
    return out, valid


class SpectralDescriptor(Descriptor):
    """A signature of the Laplacian's eigenpairs, computed on a thinned cloud and spread back to all points.

    A point is valid where its surface, a connected component of the thinned cloud, has at least ``min_points`` points
    there and is no mere line. The signature does not change when the cloud is turned or moved, but for rounding. Cost
    on one core: 64 eigenpairs of 20k points of the sub-cloud in 1.6 s, of 100k in 14 s, whatever the points.

    Args:
        spacing: Metres between points of the sub-cloud (smaller: finer detail, slower).
        link: Metres; points of the sub-cloud so near are connected. None: twice the spacing.
        eigenpairs: Per component (larger: finer detail, slower).
        n_neighbors: Nearest points that the Laplacian triangulates.
        mollify: Relative to the mean edge; how much degenerate triangles are widened.
        min_points: Components with fewer points of the sub-cloud are not described.

    Raises:
        ValueError: A number is out of range.
    """

    presets = PRESETS

    def __init__(
        self,
        spacing: float = 0.04,
        link: float | None = None,
        eigenpairs: int = 64,
        n_neighbors: int = 30,
        mollify: float = 1e-5,
        min_points: int = 64,
    ) -> None:
        self.settings = SpectrumSettings(spacing, link, eigenpairs, n_neighbors, mollify, min_points)

    @property
    @abstractmethod
    def features(self) -> int:
        """Values of a signature."""

    @abstractmethod
    def signature(self, pairs: Eigenpairs) -> Float[np.ndarray, 'samples features']:
        """Signatures of the points of one surface."""

    @final
    def compute(self, cloud: PointCloud) -> Descriptors:
        """Describe every point of a cloud."""
        samples = cloud.xyz[voxel_downsample_points(cloud.xyz, self.settings.spacing)]
        values = np.zeros((len(samples), self.features))
        surface = np.full(len(samples), -1, dtype=np.int64)
        for number, (rows, (eigenvalues, functions)) in enumerate(surface_spectra(samples, self.settings)):
            surface[rows] = number
            with one_blas_thread():
                for start in range(0, len(rows), BLOCK):
                    block = Eigenpairs(eigenvalues, functions[start : start + BLOCK])
                    values[rows[start : start + BLOCK]] = self.signature(block)
        return Descriptors(*spread_to_points(cloud.xyz, samples, surface, values))
