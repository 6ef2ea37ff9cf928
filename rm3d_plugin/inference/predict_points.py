"""Classes and instances of points for scans that nobody labelled."""

import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import torch
from jaxtyping import Float, Int
from mmengine.dataset import pseudo_collate
from tqdm import tqdm

from rm3d_plugin.datasets.base import features
from rm3d_plugin.datasets.downsampled import KeptPoints, keep_points
from rm3d_plugin.datasets.files import intensity_limits
from rm3d_plugin.datasets.semantic3d_format import GREATEST, LEAST
from rm3d_plugin.engine.config import ConfigError
from rm3d_plugin.evaluation.point_fields import numpy_of, predicted_classes
from rm3d_plugin.inference.predict_formats import ScanFile, ScanPrediction, check_format, output_name, write_prediction
from rm3d_plugin.inference.trained import TrainedNetwork
from rm3d_plugin.models.heads.proposals import Instances
from rm3d_plugin.models.segmentors.scene_inference import Flip
from rm3d_plugin.ops.segment import scatter_rows
from rm3d_plugin.pseudo_labels.propagation.nearest import nearest_label
from rm3d_plugin.storage import LabelStore
from rm3d_plugin.storage.columns import Columns, read_columns
from rm3d_plugin.storage.scans import ColorRange, NanPoints, rows_with_place, scan_of_columns
from rm3d_plugin.structures import PointCloud, PseudoLabels, SceneError

MAX_POINTS = 1_000_000  # scans with more are predicted in chunks, where neither run nor user says otherwise
OUTLIERS = 0.005  # share of the points whose intensity may be clipped without a word: mirrors in the sun
NEUTRAL = 0.5  # what the network reads as no colour and no intensity
Range = tuple[float, float]
Fill = Literal['network', 'nearest', 'likeliest']


@dataclass(frozen=True)
class PointOptions:
    """How scans are read, predicted and written.

    Attributes:
        format: See :data:`rm3d_plugin.inference.predict_formats.FORMATS`.
        tta_rotations: Directions from which a scan is read; None: as in the run's config.
        flip: 'both': from each direction mirrored, too; None: as in the run's config.
        max_points: Scans with more points are predicted in chunks; None: as in the run's config, else MAX_POINTS.
        chunk_size: Metres; edge of the chunks; None: as ``max_points`` allows.
        unknown_below: Points whose most likely class is less likely are written as unknown.
        columns: What a table's columns hold, see :func:`rm3d_plugin.storage.scans.read_scan`.
        intensity_range: Lowest and greatest intensity of the sensor, which become 0 and 1; None: as the run's data set
            has it.
        nan_points: What becomes of points without a finite place, see :func:`rm3d_plugin.storage.scans.read_scan`.
        labels: Label store of the run: points of its own scans that have a label there keep it. Scans are found by
            name.
        fill: What names the other points of these scans: the network, the nearest point with a label, or what made the
            labels, by the class that it found likeliest. None: the last where the labels have it, else the nearest.
        paint: See :class:`rm3d_plugin.inference.predict_formats.ScanFile`, as the next.
        classify: Of LAS.
    """

    format: str = 'ply'
    tta_rotations: int | None = None
    flip: Flip | None = None
    max_points: int | None = None
    chunk_size: float | None = None
    unknown_below: float = 0.0
    columns: str | None = None
    intensity_range: Range | None = None
    nan_points: NanPoints = 'error'
    labels: Path | None = None
    fill: Fill | None = None
    paint: bool = False
    classify: bool = False

    def given(self) -> list[str]:
        """Names of the options that are not their defaults."""
        return [field.name for field in fields(self) if getattr(self, field.name) != field.default]


@dataclass(frozen=True, eq=False)
class Segmenter:
    """A trained segmentor with everything it needs to read a scan.

    Attributes:
        model: The network, in evaluation mode.
        pipeline: Test-time transforms.
        classes: Class names.
        voxel_downsample: Metres to which scans are thinned, as in the run; None: they are not.
        intensity_range: See :class:`PointOptions`; None: the intensity is taken as it is.
        color_range: See :func:`rm3d_plugin.storage.scans.read_scan`.
        columns: The user's, or those of the run, but for labels.
        options: The user's.
    """

    model: Any
    pipeline: list[Any]
    classes: tuple[str, ...]
    voxel_downsample: float | None
    intensity_range: Range | None
    color_range: ColorRange
    columns: str | Columns | None
    options: PointOptions

    @classmethod
    def from_network(cls, network: TrainedNetwork, options: PointOptions) -> 'Segmenter':
        """Take over what the run says of its scans.

        Raises:
            ConfigError: An option cannot be used.
            SceneError: The format needs a package that is not installed.
        """
        if options.fill is not None and options.labels is None:
            raise ConfigError('fill: is for points without a label; name the labels of the run, too (--labels)')
        dataset, model = network.config.val_dataloader.dataset, network.model
        check_format(options.format, network.classes)
        wanted = {name: getattr(options, name) for name in ('tta_rotations', 'flip', 'max_points', 'chunk_size')}
        wanted = {name: value for name, value in wanted.items() if value is not None}
        if model.inference.max_points is None and model.inference.chunk_size is None and 'chunk_size' not in wanted:
            wanted.setdefault('max_points', MAX_POINTS)
        try:
            model.inference = replace(model.inference, **wanted)
        except ValueError as error:
            raise ConfigError(str(error)) from error
        thin = dataset.get('voxel_downsample', 0.05 if _is(dataset, 'Semantic3DDataset') else None)
        intensity = options.intensity_range or trained_intensity_range(dataset)
        color = dataset.get('color_range', 'auto')
        columns = options.columns or _without_labels(dataset.get('columns'))
        return cls(model, network.pipeline, network.classes, thin, intensity, color, columns, options)

    def read(self, path: Path) -> PointCloud:
        """Read a scan with the columns that the network wants.

        Raises:
            SceneError: The file cannot be used.
        """
        return self.fitted(self.read_file(path))

    def read_file(self, path: Path) -> ScanFile:
        """Read a scan with all that it holds.

        Raises:
            SceneError: The file cannot be used.
        """
        options, named = self.options, self.columns
        names, given = (named, None) if named is None or isinstance(named, str) else ('', named)
        columns = read_columns(path, names)
        cloud = scan_of_columns(columns, path, given, self.color_range, nan_points=options.nan_points).cloud
        whole = len(cloud) == len(next(iter(columns.values())))
        if not whole:
            rows = rows_with_place(columns, given, path)
            columns = {name: values[rows] for name, values in columns.items()}
        return ScanFile(path, columns, cloud, whole, options.paint, options.classify)

    def fitted(self, scan: ScanFile) -> PointCloud:
        """The points of a scan with the channels that the network wants."""
        inputs = self.model.inputs
        return fit_channels(scan.cloud, inputs.columns, inputs.used, self.intensity_range, scan.path.name)

    def predict(self, cloud: PointCloud, name: str = 'scan') -> ScanPrediction:
        """Predict all points of a cloud, thinned ones by the point that stands for them; stray ones are unknown.

        Args:
            cloud: Points with the channels that the network wants, see :func:`fit_channels`.
            name: For error messages.

        Raises:
            SceneError: The cloud cannot be used.
        """
        thin, sample = self._predicted(cloud, name)
        kept = len(thin.kept)
        index = numpy_of(sample.point_index)
        probs = scatter_rows(numpy_of(sample.pred_point_probs), index, kept, fill=0)
        found = None
        if 'pred_instance_masks' in sample:
            masks = scatter_rows(numpy_of(sample.pred_instance_masks).T, index, kept, fill=0).T[:, thin.rows]
            labels, scores = numpy_of(sample.pred_instance_labels), numpy_of(sample.pred_instance_scores)
            found = Instances(masks & ~thin.stray, labels, scores)
        semantic, confidence = predicted_classes(probs), probs.max(axis=1, initial=0.0)
        if self.options.labels is not None:
            own = own_labels(self.options.labels, Path(name).stem, kept)
            if own is not None:
                semantic, confidence = keep_labels(probs, cloud.xyz[thin.kept], own, self.options.fill)
        semantic = np.where(confidence < self.options.unknown_below, -1, semantic)
        semantic = np.where(thin.stray, -1, semantic[thin.rows])
        return ScanPrediction(semantic, np.where(thin.stray, 0, confidence[thin.rows]), found)

    def probabilities(self, cloud: PointCloud, name: str = 'scan') -> Float[np.ndarray, 'points classes']:
        """Class probabilities of all points of a cloud; rows of NaN where the network saw nothing.

        Args:
            cloud: See :meth:`predict`.
            name: See :meth:`predict`.

        Raises:
            SceneError: The cloud cannot be used.
        """
        thin, sample = self._predicted(cloud, name)
        probs, index = numpy_of(sample.pred_point_probs), numpy_of(sample.point_index)
        return scatter_rows(probs, index, len(thin.kept), fill=np.nan)[thin.rows]

    def _predicted(self, cloud: PointCloud, name: str) -> tuple[KeptPoints, Any]:
        world = cloud.xyz.astype(np.float64) + np.asarray(cloud.origin)
        try:
            thin = keep_points(world, self.voxel_downsample, name)
            return thin, self._sample(cloud if len(thin.kept) == len(cloud) else cloud.select(thin.kept), name)
        except ValueError as error:
            raise SceneError(f'{name}: {error}') from error

    def _sample(self, cloud: PointCloud, name: str) -> Any:
        item: dict[str, Any] = {'scene_id': name, 'index': 0, 'num_points': len(cloud), 'points': features(cloud)}
        item |= {'point_index': np.arange(len(cloud)), 'rng': np.random.default_rng(0)}
        for step in self.pipeline:
            item = step(item)
        with torch.no_grad():
            return self.model.test_step(pseudo_collate([item]))[0]


def _without_labels(columns: str | Columns | None) -> str | Columns | None:
    """Columns of a run without those of labels, which scans to be predicted need not have."""
    if columns is None or isinstance(columns, str):
        return columns
    return {part: name for part, name in columns.items() if part not in ('label', 'instance')} or None


def own_labels(labels: Path, scene: str, points: int) -> PseudoLabels | None:
    """Labels that a run has of a scan; None, with a warning, where it has none.

    Args:
        labels: Label store of the run.
        scene: Name of the scan.
        points: Of the scan.

    Raises:
        SceneError: The store has labels for another number of points.
    """
    store = LabelStore(labels)
    if scene not in store.scenes():
        warnings.warn(f'{scene}: {labels} has no labels of this scan; the network alone classifies it', stacklevel=3)
        return None
    own = store.read(scene)
    if len(own) != points:
        raise SceneError(
            f'{scene}: {labels} has labels for {len(own)} points, but the scan has {points}; name the scan that '
            'the run learnt from'
        )
    return own


def keep_labels(
    probs: Float[np.ndarray, 'points classes'], xyz: Float[np.ndarray, 'points 3'], own: PseudoLabels, fill: Fill | None
) -> tuple[Int[np.ndarray, ' points'], Float[np.ndarray, ' points']]:
    """Class and confidence of each point: those of its label, the others filled.

    Args:
        probs: What the network says.
        xyz: Metres.
        own: Labels that a run has of the points.
        fill: What names the points without a label, see :class:`PointOptions`; how sure that is, the network says.

    Raises:
        SceneError: ``fill`` asks for what the labels do not have.
    """
    known = own.semantic >= 0
    said = predicted_classes(probs)
    if fill == 'likeliest' and own.likeliest is None:
        raise SceneError(
            'fill=likeliest: these labels do not tell it, as those of merged regions or older versions: take nearest'
        )
    if fill in ('likeliest', None) and own.likeliest is not None:
        said = np.where(own.likeliest >= 0, own.likeliest, said)
    elif fill != 'network' and known.any():
        said = nearest_label(xyz, np.flatnonzero(known), own.semantic[known])
    semantic = np.where(known, own.semantic, said)
    sure = np.take_along_axis(probs, np.maximum(semantic, 0)[:, None], axis=1)[:, 0]
    return semantic, np.where(known, own.confidence, sure)


def _is(dataset: Mapping[str, Any], kind: str) -> bool:
    return str(dataset.get('type', '')).rpartition('.')[2] == kind


def trained_intensity_range(dataset: Mapping[str, Any]) -> Range | None:
    """Which intensities became 0 and 1 in training; None: they were taken as they are.

    Args:
        dataset: Config of the run's data set.
    """
    if _is(dataset, 'Semantic3DDataset'):
        return LEAST, GREATEST
    if _is(dataset, 'FilesDataset'):
        given = dataset.get('intensity_range')
        return None if given is None else intensity_limits(given)
    return 0.0, 1.0


def fit_channels(
    cloud: PointCloud,
    columns: Sequence[str],
    used: Sequence[str],
    intensity_range: Range | None,
    name: str,
) -> PointCloud:
    """The channels that a network wants, in its range: others are dropped, missing ones are neutral, with a warning.

    Args:
        cloud: As read.
        columns: What the network is given: 'intensity', 'rgb', both or none.
        used: What of it the network sees; nobody needs to be warned of the others.
        intensity_range: See :class:`PointOptions`.
        name: Of the scan, for warnings.
    """
    intensity = _unit_intensity(cloud.intensity, intensity_range, name) if 'intensity' in columns else None
    colors = cloud.colors if 'rgb' in columns else None
    missing = [
        word
        for word, part, values in (('intensity', 'intensity', intensity), ('colour', 'rgb', colors))
        if part in used and values is None
    ]
    if missing:
        warnings.warn(
            f'{name}: has no {" and no ".join(missing)}, which the network was trained with; a neutral value stands in '
            'for it, expect worse predictions',
            stacklevel=2,
        )
    if 'intensity' in columns and intensity is None:
        intensity = np.full(len(cloud), NEUTRAL, dtype=np.float32)
    if 'rgb' in columns and colors is None:
        colors = np.full((len(cloud), 3), NEUTRAL, dtype=np.float32)
    return PointCloud(cloud.xyz, colors=colors, intensity=intensity, origin=cloud.origin, sensor=cloud.sensor)


def _unit_intensity(
    intensity: Float[np.ndarray, ' points'] | None, limits: Range | None, name: str
) -> Float[np.ndarray, ' points'] | None:
    if intensity is None or limits is None:
        return intensity
    low, high = limits
    unit = (intensity - low) / (high - low)
    outside = float(((unit < 0) | (unit > 1)).mean()) if len(unit) else 0.0
    if outside > OUTLIERS:
        warnings.warn(
            f'{name}: intensity: {100 * outside:.1f} % of the points lie outside {low:g} to {high:g} and are clipped; '
            'pass --intensity-range LOW HIGH as the sensor has it',
            stacklevel=3,
        )
    return np.clip(unit, 0.0, 1.0).astype(np.float32)


def predict_points(segmenter: Segmenter, scans: Sequence[Path], out: Path, min_score: float) -> Iterator[Path]:
    """Predict each scan and write it in the format of the options.

    Args:
        segmenter: The network.
        scans: Files of the kinds that :func:`rm3d_plugin.storage.scans.read_scan` reads.
        out: Folder.
        min_score: Instances that score lower are left out.

    Yields:
        Each file when it is written.

    Raises:
        SceneError: A scan cannot be used; files already written stay.
    """
    kind = segmenter.options.format
    segmenter.model.progress = lambda chunks: tqdm(chunks, desc='chunks', unit='chunk', leave=False, disable=None)
    for scan in tqdm(scans, desc='predict', unit='scan', disable=None):
        file = segmenter.read_file(scan)
        found = segmenter.predict(segmenter.fitted(file), scan.name)
        if found.instances is not None:
            keep = found.instances.scores >= min_score
            found = replace(found, instances=Instances(*(part[keep] for part in found.instances)))
        yield from write_prediction(kind, out, output_name(scan, kind), file, found, segmenter.classes)
