"""From few labels of a scan to a label for each of its points, without training: what `rm3d label` does."""

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from tqdm import tqdm

from rm3d_plugin.inference.given_labels import GivenLabels
from rm3d_plugin.inference.outputs import check_folder, check_targets
from rm3d_plugin.inference.predict import check_names
from rm3d_plugin.inference.predict_formats import (
    BENCHMARKS,
    ScanPrediction,
    check_format,
    main_file,
    output_name,
    write_prediction,
)
from rm3d_plugin.pseudo_labels.propagation import Estimate, WalkerRules, propagate
from rm3d_plugin.pseudo_labels.propagation.choose import Choice
from rm3d_plugin.storage import write_json
from rm3d_plugin.storage.columns import read_columns, split_names
from rm3d_plugin.storage.labelled import labelled_ending, write_labelled
from rm3d_plugin.storage.scans import scan_of_columns
from rm3d_plugin.structures import PointCloud

SAME = 'same'  # the format of the input
SUMMARY = 'labels.json'


@dataclass(frozen=True)
class LabelOptions:
    """How scans are labelled and written.

    Attributes:
        format: :data:`SAME`, or one of :data:`rm3d_plugin.inference.predict_formats.FORMATS`.
        columns: See :func:`rm3d_plugin.storage.scans.read_scan`.
        check: Leave labels out in turn: for the estimate, and to take another candidate where that is better.
        seed: Of what is left out together.
    """

    format: str = SAME
    columns: str | None = None
    check: bool = True
    seed: int = 0


@dataclass(frozen=True, eq=False)
class LabelledScan:
    """Labels of one scan, and how far to trust them.

    Attributes:
        semantic: (N,) int64 class of each point; labelled points keep theirs.
        confidence: (N,) float32 probability of that class; 1 at labelled points.
        clicks: (C,) labelled points of each class.
        choice: Which candidate was taken, and what share of the left-out labels each named correctly.
        estimate: Of the mean IoU on the points without a label; None where none is possible.
        checked: Labels were to be left out.
        seconds: It took.
    """

    semantic: Int[np.ndarray, ' points']
    confidence: Float[np.ndarray, ' points']
    clicks: Int[np.ndarray, ' classes']
    choice: Choice
    estimate: Estimate | None
    checked: bool
    seconds: float

    def remark(self) -> str:
        """The estimate, or why there is none, and what was taken."""
        count, taken = int(self.clicks.sum()), self.choice.candidate
        if self.estimate is not None:
            return f'{self.estimate.text()}, from {self.estimate.labels} of your clicks; method: {taken}'
        if not self.checked:
            return f'no estimate: clicks were not checked; method: {taken} (the default)'
        if count == len(self.semantic):
            return 'no estimate: every point was labelled'
        default = '' if self.choice.accuracy else ' (the default)'
        return f'no estimate: {count} clicks are too few to leave some of each class out; method: {taken}{default}'


@dataclass(frozen=True, eq=False)
class WrittenScan:
    """A scan, what was said of it, and the files that hold it."""

    scan: Path
    labelled: LabelledScan
    files: list[Path]


def label_scan(
    cloud: PointCloud, annotated: Int[np.ndarray, ' points'], num_classes: int, check: bool = True, seed: int = 0
) -> LabelledScan:
    """Label every point of a scan from the few that are labelled, see :func:`propagate`.

    Args:
        cloud: N points, metres, z up.
        annotated: Class of each, -1 = unlabelled.
        num_classes: Number of classes.
        check: See :class:`LabelOptions`.
        seed: See :class:`LabelOptions`.

    Raises:
        ValueError: ``annotated`` does not fit.
    """
    began = time.perf_counter()
    rules = WalkerRules(seed=seed) if check else WalkerRules(seed=seed, folds=0)
    found = propagate(cloud, annotated, num_classes, rules)
    clicks = np.bincount(annotated[annotated >= 0], minlength=num_classes)
    seconds = time.perf_counter() - began
    return LabelledScan(found.semantic, found.confidence, clicks, found.choice, found.estimate, check, seconds)


def label_files(
    scans: Sequence[Path], given: GivenLabels, out: Path, options: LabelOptions | None = None
) -> Iterator[WrittenScan]:
    """Label scans one by one, write each, and :data:`SUMMARY` when all are done.

    Args:
        scans: Files, those of ``given``.
        given: Their labels.
        out: Folder.
        options: None: the defaults.

    Yields:
        Each scan when it is written.

    Raises:
        ConfigError: See :func:`check_outputs`, or the classes are not those of the benchmark.
        SceneError: A scan cannot be used; scans already written stay.
    """
    options = options or LabelOptions()
    check_outputs(scans, (), out, options)
    summary: dict[str, Any] = {}
    for scan in tqdm(scans, desc='label', unit='scan', disable=None):
        written = _label_file(scan, given, out, options)
        summary[scan.stem] = summary_of(written, given)
        yield written
    classes = [{'label': value, 'name': name} for name, value in zip(given.names, given.values, strict=True)]
    write_json(out / SUMMARY, {'classes': classes, 'scans': summary})


def _label_file(scan: Path, given: GivenLabels, out: Path, options: LabelOptions) -> WrittenScan:
    columns = read_columns(scan, options.columns)
    cloud = scan_of_columns(columns, scan).cloud
    annotated = given.scans[scan.stem].on_points(len(cloud))
    found = label_scan(cloud, annotated, len(given.names), options.check, options.seed)
    label = np.asarray(given.values)[found.semantic]
    if options.format == SAME:
        added = {'label': label.astype(np.int32), 'confidence': found.confidence}
        return WrittenScan(scan, found, [write_labelled(scan, out / target_name(scan, SAME), columns, added)])
    said = ScanPrediction(found.semantic if options.format in BENCHMARKS else label, found.confidence)
    name = output_name(scan, options.format)
    return WrittenScan(scan, found, write_prediction(options.format, out, name, cloud, said, given.names))


def summary_of(written: WrittenScan, given: GivenLabels) -> dict[str, Any]:
    """What :data:`SUMMARY` says of a scan; shares are percent."""
    found = written.labelled
    points, estimate = np.bincount(found.semantic, minlength=len(given.names)), found.estimate
    return {
        'files': [path.name for path in written.files],
        'points': dict(zip(given.names, points.tolist(), strict=True)),
        'clicks': dict(zip(given.names, found.clicks.tolist(), strict=True)),
        'estimate': None
        if estimate is None
        else {'miou': estimate.miou, 'low': estimate.low, 'high': estimate.high, 'clicks': estimate.labels},
        'method': found.choice.candidate,
        'left_out_accuracy': {name: 100 * share for name, share in found.choice.accuracy.items()},
        'seconds': round(found.seconds, 2),
    }


def target_name(scan: Path, kind: str) -> str:
    """Name of the main file that is written for a scan, with its ending."""
    return f'{scan.stem}{labelled_ending(scan)}' if kind == SAME else main_file(scan, kind)


def check_outputs(scans: Sequence[Path], inputs: Sequence[Path], out: Path, options: LabelOptions) -> None:
    """Whether everything can be written, and over nothing that was read.

    Args:
        scans: To be labelled.
        inputs: Further files that are read.
        out: Folder.
        options: Of the output.

    Raises:
        ConfigError: Two scans have one name, an output would replace an input, or the format is not known.
        SceneError: Columns make no sense, or a package is not installed.
    """
    if options.columns is not None:
        split_names(options.columns)
    if options.format != SAME:
        check_format(options.format, ())
    check_names(scans, [scan.stem for scan in scans])
    check_folder(out)
    targets = [*(out / target_name(scan, options.format) for scan in scans), out / SUMMARY]
    check_targets(targets, [*scans, *inputs], out)
