"""Points in LAS and LAZ files, through laspy (the extra ``las``)."""

from pathlib import Path

import numpy as np

from rm3d_plugin.structures import SceneError

RGB = ('red', 'green', 'blue')


def read_las(path: str | Path) -> dict[str, np.ndarray]:
    """The dimensions of a file under their names; x, y, z are scaled to the file's unit, float64.

    Colours that are black throughout are left out: the file has room for them, but no camera was there.

    Raises:
        SceneError: The file is missing or damaged, or laspy is not installed.
    """
    path = Path(path)
    if not path.is_file():
        raise SceneError(f'{path}: no such file; expected a LAS or LAZ file')
    try:
        import laspy
    except ImportError as error:
        raise SceneError(f'{path}: LAS and LAZ need laspy; pip install "rm3d_plugin[las]"') from error
    try:
        with laspy.open(path) as file:
            announced, las = file.header.point_count, file.read()
    except Exception as error:  # laspy and its decompressors raise whatever they come across
        reason = str(error) or type(error).__name__
        raise SceneError(f'{path}: not readable as LAS or LAZ ({reason}); copy it again') from error
    if len(las.points) != announced:
        raise SceneError(f'{path}: {len(las.points)} points, but the header says {announced}; cut off? copy it again')
    if not (np.isfinite(las.header.scales) & (las.header.scales != 0)).all():
        scales = ' '.join(f'{scale:g}' for scale in las.header.scales)
        raise SceneError(f'{path}: scales {scales} in the header; expected numbers above 0: export it again')
    scaled = {name: np.asarray(getattr(las, name), dtype=np.float64) for name in 'xyz'}
    rest = (str(name) for name in las.point_format.dimension_names)
    columns = scaled | {name: np.asarray(las[name]) for name in rest if name not in 'XYZ'}
    if not any(columns[name].any() for name in RGB if name in columns):
        columns = {name: values for name, values in columns.items() if name not in RGB}
    return columns
