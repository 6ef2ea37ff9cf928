"""What a file is by its first bytes, where its name says something else."""

from pathlib import Path

from rm3d_plugin.structures import SceneError

_UNPACK = 'unpack it first'
_FETCH = 'fetch its content: git lfs pull'
_AGAIN = 'download it again'
SIGNATURES = (
    (b'PK\x03\x04', ('.npz',), 'a zip archive', _UNPACK),
    (b'\x1f\x8b\x08\x00', (), 'a gzip archive', _UNPACK),
    (b'\x1f\x8b\x08\x08', (), 'a gzip archive', _UNPACK),
    (b'BZh9', (), 'a bzip2 archive', _UNPACK),
    (b'\xfd7zXZ\x00', (), 'an xz archive', _UNPACK),
    (b'7z\xbc\xaf\x27\x1c', (), 'a 7z archive', _UNPACK),
    (b'\x28\xb5\x2f\xfd', (), 'a zstd archive', _UNPACK),
    (b'version https://git-lfs', (), 'a pointer of Git LFS', _FETCH),
    (b'<!DOCTYPE', (), 'a web page', _AGAIN),
    (b'<html', (), 'a web page', _AGAIN),
    (b'\x89PNG', (), 'a picture', 'name a scan'),
    (b'\x89HDF', (), 'HDF5', 'export its points as .npz or .ply'),
    (b'\x93NUMPY', ('.npy',), 'an array of numpy', 'name it .npy'),
    (b'ply\n', ('.ply',), 'a PLY file', 'name it .ply'),
    (b'ply\r\n', ('.ply',), 'a PLY file', 'name it .ply'),
    (b'LASF', ('.las', '.laz'), 'a LAS file', 'name it .las or .laz'),
    (b'ASTM-E57', ('.e57',), 'an E57 file', 'name it .e57'),
    (b'# .PCD', ('.pcd',), 'a PCD file', 'name it .pcd'),
)
"""First bytes, the endings that they belong to, what they tell, and what to do. Raw numbers may begin with any two
bytes, hardly with any four."""


def check_signature(path: Path) -> None:
    """Whether a file begins like another kind than its ending says.

    Raises:
        SceneError: It does; the message says what it is, and what to do.
    """
    with path.open('rb') as file:
        first = file.read(32)
    for begin, endings, what, advice in SIGNATURES:
        if first.startswith(begin) and path.suffix.lower() not in endings:
            if path.suffix.lower() == '.npy' and '.npz' in endings:
                raise SceneError(f'{path}: holds an archive, not one array; name it .npz')
            raise SceneError(f'{path}: is {what}, not {path.suffix}; {advice}')
