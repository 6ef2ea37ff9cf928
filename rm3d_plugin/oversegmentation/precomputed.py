"""A partition that came from elsewhere."""

import zipfile
import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import final

import numpy as np
from jaxtyping import Int

from rm3d_plugin.oversegmentation.base import Oversegmenter
from rm3d_plugin.registry import OVERSEGMENTERS
from rm3d_plugin.storage.files import MALFORMED
from rm3d_plugin.storage.npy import read_archive, read_npy
from rm3d_plugin.structures import Descriptors, PointCloud, SceneError


@OVERSEGMENTERS.register_module()
@final
class Precomputed(Oversegmenter):
    """Uses given labels, whatever the descriptors.

    Args:
        labels: Region of each point of the only scene, -1 = discarded.
        files: For many scenes: path of the file of each, with ``{scene}`` for its name, such as
            ``regions/{scene}.npz``. It is ``.npz`` with the array ``labels``, as ``oversegment`` writes, or ``.npy``.

    Raises:
        ValueError: Both or neither are given, or ``files`` does not name the scene.
    """

    def __init__(
        self, labels: Int[np.ndarray, ' points'] | Sequence[int] | None = None, files: str | None = None
    ) -> None:
        super().__init__(scene_files=files)  # ground is kept: a given partition says itself what is discarded
        if (labels is None) == (files is None):
            raise ValueError('Precomputed: expected labels (one scene) or files (many), got both or neither')
        if files is not None and '{scene}' not in files:
            raise ValueError(f'Precomputed.files: expected a path with {{scene}} in it, got {files!r}')
        self.labels = None if labels is None else np.asarray(labels)

    def partition(
        self,
        cloud: PointCloud,
        descriptors: Descriptors,
        seeds: Int[np.ndarray, ' seeds'] | None = None,
        scene: str = '',
    ) -> Int[np.ndarray, ' points']:
        """The given labels.

        Raises:
            SceneError: The scene has no file, or it is no list of whole numbers, one a point.
        """
        path = self.scene_file(scene)
        labels = self.labels if path is None else _read(path, scene)
        assert labels is not None  # one of the two was given
        if labels.shape != (len(cloud),):
            where = 'Precomputed.labels' if path is None else str(path)
            raise SceneError(f'{where}: expected shape ({len(cloud)},), one label a point, got {labels.shape}')
        return labels


def _read(path: Path, scene: str) -> Int[np.ndarray, ' points']:
    if not path.is_file():
        raise SceneError(f'Precomputed: scene {scene!r} has no file {path}; write one for every scene, or mend `files`')
    try:
        labels = read_npy(path) if path.suffix == '.npy' else read_archive(path)['labels']
        return labels.astype(np.int64, casting='safe')
    except (*MALFORMED, zipfile.BadZipFile, zlib.error, EOFError, OSError, MemoryError, RuntimeError) as error:
        raise SceneError(f'{path}: expected whole numbers, in .npz as the array `labels` ({error})') from error
