"""Results that are costly to make and depend on nothing but their key."""

import warnings
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from rm3d_plugin.storage.files import DamagedFileError, read_npz, remove_unfinished, write_npz

FORGOTTEN = 86_400.0  # s; a file takes seconds to write, so one that old was left by a killed process


class SceneCache:
    """Arrays by content key, one file a key.

    Several processes may share the folder: a file appears as a whole, and when two make the same one, the last stays
    (they are equal, since the key names the content and the parameters).

    Args:
        root: Folder of the files; made when first needed.
    """

    def __init__(self, root: str | Path) -> None:
        self.root = Path(root)
        self._tidied = False

    def path(self, key: str) -> Path:
        """The file of a key.

        Raises:
            ValueError: The key cannot be a file name; make it with :func:`content_key`.
        """
        if not key or not all(c.isalnum() or c in '-_.' for c in key) or key.startswith('.'):
            raise ValueError(f'SceneCache: {key!r} cannot be a file name; use letters, digits, "-", "_" and "."')
        return self.root / f'{key}.npz'

    def get_or_make(self, key: str, make: Callable[[], Mapping[str, np.ndarray]]) -> dict[str, np.ndarray]:
        """The arrays of a key, from the file or else from ``make``.

        Args:
            key: From :func:`content_key` of everything the result depends on.
            make: Called where there is no usable file.

        Returns:
            Name -> array, the same whether read or just made. A damaged file is reported by a warning that names it,
            and made again.
        """
        path = self.path(key)
        try:
            return read_npz(path)
        except FileNotFoundError:
            pass
        except DamagedFileError as error:
            warnings.warn(f'{error}. It is made again now.', stacklevel=2)
        if not self._tidied:
            remove_unfinished(self.root, '*', older=FORGOTTEN)
            self._tidied = True
        arrays = {name: np.asarray(value) for name, value in make().items()}
        write_npz(path, arrays)
        return arrays
