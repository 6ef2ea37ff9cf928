"""Few labels of scans in, the scans with a label for each point out: what `rm3d label` does before any training."""

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Int
from tqdm import tqdm

from rm3d_plugin.engine.config import ConfigError
from rm3d_plugin.engine.work_dir import check_folder
from rm3d_plugin.inference.given_labels import GivenLabels
from rm3d_plugin.inference.label_scan import LabelledScan, at_all_points, drawn_points, label_prepared, prepare_drawn
from rm3d_plugin.inference.outputs import check_targets
from rm3d_plugin.inference.predict import check_names
from rm3d_plugin.inference.predict_formats import (
    BENCHMARKS,
    ScanFile,
    ScanPrediction,
    check_format,
    main_file,
    output_name,
    write_prediction,
)
from rm3d_plugin.inference.scan_kind import ScanKind, scan_kind
from rm3d_plugin.pseudo_labels.propagation import Beside, PreparedCloud, examples_of
from rm3d_plugin.storage import write_json
from rm3d_plugin.storage.columns import read_columns, split_names
from rm3d_plugin.storage.labelled import labelled_ending, write_labelled
from rm3d_plugin.storage.recent import RecentItems
from rm3d_plugin.storage.scans import scan_of_columns
from rm3d_plugin.structures import PointCloud

SAME = 'same'  # the format of the input
SUMMARY = 'labels.json'
IN_MEMORY = 2048  # MB of scans that were prepared once to teach others


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
class WrittenScan:
    """A scan, its kind, what was said of it, and the files that hold it."""

    scan: Path
    kind: ScanKind
    labelled: LabelledScan
    files: list[Path]


class _Example(NamedTuple):
    features: np.ndarray
    classes: np.ndarray


class PreparedScan(NamedTuple):
    """A scan that was read, and the points of it that labels spread over.

    Attributes:
        columns: What its file holds.
        cloud: All points.
        drawn: See :func:`~rm3d_plugin.inference.label_scan.drawn_points`.
        scene: Graph and features of the points drawn.
        seconds: That this took.
    """

    columns: dict[str, np.ndarray]
    cloud: PointCloud
    drawn: Int[np.ndarray, ' drawn']
    scene: PreparedCloud
    seconds: float


class LabelledFiles:
    """Scans of which few points are labelled; labels of each teach the others what classes look like.

    Args:
        scans: Files, each of another name, those of ``given``.
        given: Their labels.
        options: How they are read.
    """

    def __init__(self, scans: Sequence[Path], given: GivenLabels, options: LabelOptions) -> None:
        self.scans, self.given, self.options = list(scans), given, options
        self._recent: RecentItems[PreparedScan] = RecentItems(IN_MEMORY, _nbytes)

    def prepared(self, scan: Path) -> PreparedScan:
        """A scan with its graph and features, from memory or made now."""
        return self._recent.get_or_make(scan.stem, lambda: self._prepare(scan))

    def _prepare(self, scan: Path) -> PreparedScan:
        columns = read_columns(scan, self.options.columns)
        cloud, began = scan_of_columns(columns, scan).cloud, time.perf_counter()
        drawn = drawn_points(len(cloud), np.flatnonzero(self.annotated(scan, len(cloud)) >= 0))
        scene = prepare_drawn(cloud, drawn)
        return PreparedScan(columns, cloud, drawn, scene, time.perf_counter() - began)

    def labelled(self, scan: Path, beside: Beside) -> LabelledScan:
        """Labels of all points of a scan.

        Args:
            scan: Which.
            beside: What is known beside its labels, of all its points.
        """
        prepared, options = self.prepared(scan), self.options
        drawn, points = prepared.drawn, len(prepared.cloud)
        if beside.network is not None:
            beside = replace(beside, network=beside.network[drawn])
        if beside.unseen is not None:
            beside = replace(beside, unseen=beside.unseen[drawn])
        annotated, classes = self.annotated(scan, points)[drawn], len(self.given.names)
        found = label_prepared(
            prepared.scene, annotated, classes, options.check, options.seed, beside, prepared.seconds
        )
        return at_all_points(found, prepared.cloud, drawn)

    def annotated(self, scan: Path, points: int) -> Int[np.ndarray, ' points']:
        """Class of each point, -1 = unlabelled."""
        return self.given.scans[scan.stem].on_points(points)

    def beside(self, scan: Path) -> Beside:
        """What the other scans with the same channels teach; every class that any of them shows may be there.

        Raises:
            ConfigError: The scan has no label, and no other with its channels has one.
        """
        if len(self.scans) < 2:
            return Beside()
        width = self._examples[scan.stem].features.shape[1]
        alike = {name: each for name, each in self._examples.items() if each.features.shape[1] == width}
        others = [each for name, each in alike.items() if name != scan.stem and len(each.classes)]
        if not others and not len(self._examples[scan.stem].classes):
            raise ConfigError(
                f'{scan}: has no label, and no other scan with the same channels (colour, intensity) has one; label '
                'some of its points, or leave it out'
            )
        if not others:
            return Beside()
        possible = np.zeros(len(self.given.names), dtype=np.bool_)
        possible[np.concatenate([each.classes for each in alike.values()])] = True
        features, classes = (np.concatenate(parts) for parts in zip(*others, strict=True))
        return Beside(features, classes, possible=possible)

    @cached_property
    def _examples(self) -> dict[str, _Example]:
        found = {}
        for scan in tqdm(self.scans, desc='what classes look like', unit='scan', leave=False, disable=None):
            prepared = self.prepared(scan)
            annotated = self.annotated(scan, len(prepared.cloud))[prepared.drawn]
            found[scan.stem] = _Example(*examples_of(prepared.scene, annotated))
        return found


def _nbytes(prepared: PreparedScan) -> int:
    scene = prepared.scene
    edges = [part for graph in scene.graphs for part in (graph.weights.data, graph.weights.indices)]
    return sum(part.nbytes for part in (*prepared.columns.values(), *edges, prepared.cloud.xyz))


class Summary:
    """:data:`SUMMARY` of a folder, written anew whenever a scan is added.

    Args:
        out: The folder.
        given: Names and numbers of the classes.
    """

    def __init__(self, out: Path, given: GivenLabels) -> None:
        self._path = out / SUMMARY
        pairs = zip(given.names, given.values, strict=True)
        self._content: dict[str, Any] = {'classes': [{'label': value, 'name': name} for name, value in pairs]}
        self._content['scans'] = {}

    def add(self, name: str, entry: dict[str, Any]) -> None:
        """Say something of a scan, in place of what was said before."""
        self._content['scans'][name] = entry
        write_json(self._path, self._content)


def label_files(files: LabelledFiles, out: Path, summary: Summary) -> Iterator[WrittenScan]:
    """Label scans one by one and write each; ``summary`` tells of all that are done.

    Args:
        files: The scans and their labels.
        out: Folder.
        summary: Of the folder.

    Yields:
        Each scan when it is written.

    Raises:
        ConfigError: The classes are not those of the benchmark, or nothing teaches a scan.
        SceneError: A scan cannot be used; scans already written stay.
    """
    given, options = files.given, files.options
    besides = [files.beside(scan) for scan in files.scans]  # what cannot be is told before anything is written
    steps = ('neighbours', 'labels', 'file')
    with tqdm(desc='label', unit='step', total=len(steps) * len(besides), disable=None) as bar:
        for scan, beside in zip(files.scans, besides, strict=True):
            bar.set_postfix_str(f'{scan.name}: {steps[0]}')
            prepared = files.prepared(scan)
            _ahead(bar, f'{scan.name}: {steps[1]}')
            found = files.labelled(scan, beside)
            _ahead(bar, f'{scan.name}: {steps[2]}')
            paths = write_scan(scan, prepared.columns, prepared.cloud, found, given, out, options.format)
            written = WrittenScan(scan, scan_kind(prepared.cloud), found, paths)
            summary.add(scan.stem, summary_of(written, given))
            bar.update()
            yield written


def _ahead(bar: 'tqdm[Any]', text: str) -> None:
    bar.update()
    bar.set_postfix_str(text)


def write_scan(
    scan: Path,
    columns: dict[str, np.ndarray],
    cloud: PointCloud,
    found: LabelledScan,
    given: GivenLabels,
    out: Path,
    kind: str,
) -> list[Path]:
    """Write a scan with its labels; the files.

    Args:
        scan: The file that was read.
        columns: What it holds.
        cloud: Its points.
        found: Their labels.
        given: Names and numbers of the classes.
        out: Folder.
        kind: Format, see :class:`LabelOptions`.
    """
    label = np.asarray(given.values)[found.semantic]
    if kind == SAME:
        added = {
            'label': label.astype(np.int32), 'confidence': found.confidence, 'region': found.region.astype(np.int32)
        }  # fmt: skip
        return [write_labelled(scan, out / target_name(scan, SAME), columns, added)]
    said = ScanPrediction(found.semantic if kind in BENCHMARKS else label, found.confidence)
    file = ScanFile(scan, columns, cloud)
    return write_prediction(kind, out, output_name(scan, kind), file, said, given.names)


def summary_of(written: WrittenScan, given: GivenLabels) -> dict[str, Any]:
    """What :data:`SUMMARY` says of a scan; shares are percent."""
    found = written.labelled
    points, estimate = np.bincount(found.semantic, minlength=len(given.names)), found.estimate
    return {
        'files': [path.name for path in written.files],
        'kind': written.kind.kind,
        'points': dict(zip(given.names, points.tolist(), strict=True)),
        'clicks': dict(zip(given.names, found.clicks.tolist(), strict=True)),
        'estimate': None
        if estimate is None
        else {'miou': estimate.miou, 'low': estimate.low, 'high': estimate.high, 'clicks': estimate.labels},
        'method': found.method,
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
