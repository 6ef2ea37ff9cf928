"""Predictions for scans that nobody labelled: boxes from a detector, classes of points from a segmentor."""

from collections.abc import Iterator, Sequence
from pathlib import Path

from rm3d_plugin.engine.config import ConfigError
from rm3d_plugin.engine.work_dir import check_folder
from rm3d_plugin.inference.outputs import check_targets
from rm3d_plugin.inference.predict_boxes import BoxOptions, Detector, box_targets, calib_beside, predict_boxes
from rm3d_plugin.inference.predict_formats import main_file, output_name
from rm3d_plugin.inference.predict_points import PointOptions, Segmenter, predict_points
from rm3d_plugin.inference.trained import load_network
from rm3d_plugin.models.segmentors import RM3DSegmentor
from rm3d_plugin.storage.columns import ENDINGS, split_names
from rm3d_plugin.storage.plain_files import visible

OF_BOTH = ('format', 'columns', 'intensity_range', 'nan_points')  # options of points that boxes have, too


def predict_files(
    checkpoint: str | Path,
    scans: Sequence[Path],
    out: Path,
    min_score: float | None = None,
    device: str = 'cpu',
    options: PointOptions | None = None,
) -> Iterator[Path]:
    """Predict each scan with whatever network the checkpoint holds.

    Args:
        checkpoint: Of a training run.
        scans: Files of every kind that :func:`rm3d_plugin.storage.scans.read_scan` reads, or folders of them.
        out: Folder for what is written.
        min_score: Boxes and instances that score lower are left out; None: 0.1 for boxes, 0 for instances.
        device: cpu, cuda, cuda:1 ...
        options: Of a segmentor; what a detector has of them, it takes from there.

    Yields:
        Each file when it is written.

    Raises:
        SceneError, ConfigError: A scan, the checkpoint or an option cannot be used; files already written stay.
    """
    if options is not None and options.columns is not None:
        split_names(options.columns)
    check_folder(out)
    files = find_scans(scans, ENDINGS)
    network = load_network(checkpoint, device)
    if isinstance(network.model, RM3DSegmentor):
        options = options or PointOptions()
        check_names(files, [output_name(scan, options.format) for scan in files])
        check_targets([out / main_file(scan, options.format) for scan in files], [*files, Path(checkpoint)], out)
        yield from predict_points(Segmenter.from_network(network, options), files, out, min_score or 0.0)
        return
    boxes = _box_options(checkpoint, options)
    check_names(files, [scan.stem for scan in files])
    calibrations = [found for scan in files if (found := calib_beside(scan)) is not None]
    targets = [target for scan in files for target in box_targets(scan, out, boxes)]
    check_targets(targets, [*files, *calibrations, Path(checkpoint)], out)
    least = 0.1 if min_score is None else min_score
    yield from predict_boxes(Detector.from_network(network), files, out, least, boxes)


def _box_options(checkpoint: str | Path, options: PointOptions | None) -> BoxOptions:
    given = [] if options is None else options.given()
    if strange := [name for name in given if name not in OF_BOTH]:
        raise ConfigError(f'{checkpoint} finds boxes; {", ".join(strange)} is for networks that classify points')
    return BoxOptions(**{name: getattr(options, name) for name in given})


def find_scans(paths: Sequence[Path], endings: Sequence[str]) -> list[Path]:
    """The named files, and of folders those with one of the endings that are not hidden, sorted.

    Raises:
        ConfigError: There are none, or one that is named is not there or of no such kind.
    """
    found: list[Path] = []
    for path in paths:
        if not path.exists():
            raise ConfigError(f'{path}: no such file or folder')
        if not path.is_dir() and path.suffix.lower() not in endings:
            raise ConfigError(f'{path}: unknown ending {path.suffix!r}; expected one of {" ".join(endings)}')
        inside = sorted(visible(path.iterdir())) if path.is_dir() else [path]
        found += [file for file in inside if not path.is_dir() or file.suffix.lower() in endings]
    if not found:
        raise ConfigError(f'no {" ".join(endings)} file in {", ".join(map(str, paths))}')
    return found


def check_names(scans: Sequence[Path], names: Sequence[str]) -> None:
    """Whether each scan has an output of its own.

    Raises:
        ConfigError: Two would be written to the same file.
    """
    first: dict[str, Path] = {}
    for scan, name in zip(scans, names, strict=True):
        if name in first:
            raise ConfigError(f'{first[name]} and {scan} would be written to the same file {name}; name one at a time')
        first[name] = scan
