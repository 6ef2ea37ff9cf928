"""Features that came from elsewhere: of a foundation model, say, or of a network of one's own."""

import zipfile
import zlib
from pathlib import Path
from typing import NamedTuple, final

import numpy as np
from jaxtyping import Float

from rm3d_plugin.descriptors.base import Descriptor
from rm3d_plugin.ops.octree import Octree
from rm3d_plugin.registry import DESCRIPTORS
from rm3d_plugin.storage.files import MALFORMED
from rm3d_plugin.storage.npy import read_archive, read_npy
from rm3d_plugin.structures import Descriptors, PointCloud, SceneError

FORM = '.npz with `xyz` (M, 3) and `features` (M, F), or .npy (M, 3 + F) that begins with x, y and z'


class _Given(NamedTuple):
    xyz: Float[np.ndarray, 'given 3']
    features: Float[np.ndarray, 'given features']


@DESCRIPTORS.register_module()
@final
class External(Descriptor):
    """Each point has the features of the nearest place in a file of its scene.

    Matched by place, so that it does not matter in which order, how densely and with or without the ground they were
    computed.

    Args:
        files: Path of the file of each scene, with ``{scene}`` for its name: ``.npz`` with ``xyz`` (M, 3) metres in the
            coordinates of the scan and ``features`` (M, F), or ``.npy`` (M, 3 + F) that begins with x, y and z.
        max_distance: Metres; points farther from every place are not described.

    Raises:
        ValueError: ``files`` does not name the scene, or the distance is not positive.
    """

    def __init__(self, files: str, max_distance: float = 0.05) -> None:
        if '{scene}' not in files:
            raise ValueError(f'External.files: expected a path with {{scene}} in it, got {files!r}')
        if not max_distance > 0:
            raise ValueError(f'External.max_distance: expected metres above 0, got {max_distance}')
        self.files, self.max_distance = files, max_distance
        self._scene: str | None = None

    def for_scene(self, scene: str) -> 'External':
        """The same that reads the file of a scene."""
        out = External(self.files, self.max_distance)
        out._scene = scene
        return out

    def scene_file(self, scene: str) -> Path:
        """The file of a scene."""
        return Path(self.files.format(scene=scene))

    def compute(self, cloud: PointCloud) -> Descriptors:
        """Look up the features of every point.

        Raises:
            SceneError: No scene was named, it has no file, the file holds something else, or it lies elsewhere.
        """
        if self._scene is None:
            raise SceneError('External: needs the name of the scene: External(...).for_scene(NAME).compute(cloud)')
        path = self.scene_file(self._scene)
        given = _read(path, self._scene)
        places = np.ascontiguousarray(given.xyz - np.asarray(cloud.origin))
        near = Octree(places).knn(cloud.xyz.astype(np.float64), 1)
        valid = np.sqrt(near.sq_dists[:, 0]) <= self.max_distance
        if len(cloud) and not valid.any():
            raise SceneError(
                f'{path}: no place lies within {self.max_distance:g} m of a point of scene {self._scene!r}; expected '
                'metres in the coordinates of the scan, or give descriptor.max_distance'
            )
        values = given.features[near.indices[:, 0]].astype(np.float32)
        values[~valid] = 0.0
        return Descriptors(values, valid)


def _read(path: Path, scene: str) -> _Given:
    if not path.is_file():
        raise SceneError(f'External: scene {scene!r} has no file {path}; write one for every scene, or mend `files`')
    try:
        if path.suffix == '.npy':
            table = read_npy(path)
            xyz, features = table[:, :3], table[:, 3:]
        else:
            arrays = read_archive(path)
            xyz, features = arrays['xyz'], arrays['features']
        given = _Given(xyz.astype(np.float64, casting='same_kind'), features.astype(np.float32, casting='same_kind'))
    except (*MALFORMED, zipfile.BadZipFile, zlib.error, EOFError, OSError, IndexError) as error:
        raise SceneError(f'{path}: expected {FORM} ({error})') from error
    rows = len(given.xyz)
    if (
        given.xyz.shape != (rows, 3)
        or given.features.shape != (rows, given.features.shape[-1])
        or not given.features.size
    ):
        raise SceneError(f'{path}: expected {FORM}, got xyz {given.xyz.shape} and features {given.features.shape}')
    if not (np.isfinite(given.xyz).all() and np.isfinite(given.features).all()):
        raise SceneError(f'{path}: holds NaN or infinite numbers; leave these points out, then they are not described')
    return given
