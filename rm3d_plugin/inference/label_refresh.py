"""Labels once more, with a trained network where labels that it was not taught speak for it; and further scans."""

import time
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from jaxtyping import Int
from mmengine.config import Config
from tqdm import tqdm

from rm3d_plugin.engine.config import ConfigError
from rm3d_plugin.inference.label_files import LabelledFiles, Summary, WrittenScan, summary_of, write_scan
from rm3d_plugin.inference.label_scan import LabelledScan, regions_of
from rm3d_plugin.inference.label_training import TrainingOptions, train_network
from rm3d_plugin.inference.predict_points import Segmenter
from rm3d_plugin.inference.scan_kind import Kind, scan_kind
from rm3d_plugin.labeling.walker import WalkerLabelMaker
from rm3d_plugin.registry import TASK_UTILS
from rm3d_plugin.storage.columns import read_columns
from rm3d_plugin.storage.scans import scan_of_columns


def label_again(
    files: LabelledFiles,
    kind: Kind,
    more: Sequence[Path],
    out: Path,
    options: TrainingOptions,
    summary: Summary,
) -> Iterator[WrittenScan]:
    """Train, label the scans again, and predict further ones.

    A scan is written again only where labels that the network was not taught speak for it.

    Args:
        files: The scans and their labels, already written once.
        kind: Of the scans.
        more: Further scans, without labels.
        out: Folder; the run comes into ``training``.
        options: How long.
        summary: Of the folder.

    Yields:
        Each scan of ``files``; its ``files`` are empty where the first labels stand. Then each of ``more``, written.

    Raises:
        ConfigError: See :func:`train_network`.
        SceneError: A scan cannot be used.

    Warns:
        UserWarning: Further scans are predicted although no label speaks for the network.
    """
    network, config = train_network(files, kind, out / 'training', options, time.monotonic())
    judges, heard = judges_of(config), False
    for scan in tqdm(files.scans, desc='label again', unit='scan', disable=None):
        found = _with_network(files, scan, network, judges[scan.stem])
        prepared = files.prepared(scan)
        cloud, paths = prepared.cloud, []
        heard |= bool(found.network_weight)
        if found.network_weight:
            paths = write_scan(scan, prepared.columns, cloud, found, files.given, out, files.options.format)
        written = WrittenScan(scan, scan_kind(cloud), found, paths)
        if paths:
            summary.add(scan.stem, summary_of(written, files.given))
        yield written
    if more and not heard:
        warnings.warn(
            f'--more: {len(more)} scans are predicted by a network for which clicks that it was not taught speak on no'
            ' labelled scan: look at the result, click more points, or give more minutes',
            stacklevel=2,
        )
    for scan in tqdm(more, desc='predict', unit='scan', disable=None):
        written = _predicted(files, scan, network, out)
        summary.add(scan.stem, summary_of(written, files.given))
        yield written


def judges_of(config: Config) -> Mapping[str, Int[np.ndarray, ' judging']]:
    """Points of each scan whose labels a run was not told.

    Raises:
        ConfigError: Labels of the run do not spread by a random walk, so that all are told.
    """
    hook = next(hook for hook in config.custom_hooks if hook.type == 'RegionMergeHook')
    maker = TASK_UTILS.build(hook.label_maker)
    if not isinstance(maker, WalkerLabelMaker):
        raise ConfigError('--train: no label is kept back to judge the network; leave walker, strategy and propagate')
    return maker.known.judges


def _with_network(
    files: LabelledFiles, scan: Path, network: Segmenter, judges: Int[np.ndarray, ' judging']
) -> LabelledScan:
    unseen = np.zeros(len(files.prepared(scan).cloud), dtype=np.bool_)
    unseen[judges] = True
    said = network.probabilities(network.read(scan), scan.name)
    return files.labelled(scan, replace(files.beside(scan), network=said, unseen=unseen))


def _predicted(files: LabelledFiles, scan: Path, network: Segmenter, out: Path) -> WrittenScan:
    began, classes = time.perf_counter(), len(files.given.names)
    columns = read_columns(scan, files.options.columns)
    cloud = scan_of_columns(columns, scan).cloud
    said = network.predict(network.read(scan), scan.name)
    none, region = np.zeros(classes, dtype=np.int64), regions_of(cloud)
    seconds = time.perf_counter() - began
    found = LabelledScan.spread(said.semantic, said.confidence, region, none, 'network', seconds)
    paths = write_scan(scan, columns, cloud, found, files.given, out, files.options.format)
    return WrittenScan(scan, scan_kind(cloud), found, paths)
