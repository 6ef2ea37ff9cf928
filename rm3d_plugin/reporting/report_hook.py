"""Leaves ``report.html`` in the work directory."""

import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from mmengine.dataset import pseudo_collate
from mmengine.dist import is_main_process
from mmengine.hooks import Hook
from mmengine.runner import Runner

from rm3d_plugin.datasets.base import Truth
from rm3d_plugin.engine.config_files import ConfigError
from rm3d_plugin.engine.hooks.region_merge_hook import RegionMergeHook
from rm3d_plugin.engine.hooks.run_record_hook import read_record
from rm3d_plugin.evaluation.point_fields import numpy_of
from rm3d_plugin.registry import HOOKS
from rm3d_plugin.reporting.box_scenes import TRUTH, box_view
from rm3d_plugin.reporting.merges import merge_report
from rm3d_plugin.reporting.run_report import run_report, scene_picture
from rm3d_plugin.reporting.scenes import (
    SceneRecord,
    pick_scenes,
    point_classes,
    point_instances,
    scene_from_above,
    views_of,
)
from rm3d_plugin.structures import Boxes3D, PointCloud, SceneError
from rm3d_plugin.visualization import Picture, write_report
from rm3d_plugin.visualization.scene_view import SceneView, pack_views


@HOOKS.register_module()
class ReportHook(Hook):
    """After training: one self-contained page with scores, curves, labels of each round and pictures.

    It tells of the labels of a :class:`RegionMergeHook`, and of the scores that a ``RunRecordHook`` noted. Pictures
    need data sets like ours (``rm3d_plugin.datasets.SceneDataset``) and a model that predicts boxes or classes of
    points.

    Args:
        train_scenes: How many training scenes are shown with regions, pseudo labels and predictions.
        val_scenes: How many validation scenes are shown with predictions.
    """

    priority = 'VERY_LOW'

    def __init__(self, train_scenes: int = 2, val_scenes: int = 2) -> None:
        self.train_scenes, self.val_scenes = train_scenes, val_scenes
        self._began = time.perf_counter()

    def before_train(self, runner: Runner) -> None:
        """Start the clock of this process; tell at once what the page would lack in the end.

        Raises:
            ConfigError: A data set cannot be drawn.
        """
        self._began = time.perf_counter()
        merging = _merging(runner)
        if not merging:
            runner.logger.warning('ReportHook: there is no RegionMergeHook, of whose labels it tells; no report.html')
            return
        if self.train_scenes and merging[0].label_maker.task == 'segmentation':
            _need(merging[0].dataloader.dataset, ('scene_ids',), 'train_scenes')
        if self.val_scenes and runner.val_loop is not None:
            _need(runner.val_dataloader.dataset, _DRAWN, 'val_scenes')

    def after_train(self, runner: Runner) -> None:
        """Write the page; where a prediction cannot be drawn, that is told and the trained run stands without it."""
        merging = _merging(runner)
        if not is_main_process() or not merging:
            return
        try:
            self._write(runner, merging)
        except SceneError as error:
            runner.logger.error(f'no report.html: {error}; train_scenes=0 and val_scenes=0 leave pictures out')

    def _write(self, runner: Runner, merging: list[RegionMergeHook]) -> None:
        label_maker = merging[0].label_maker
        times = merging[0].times.rounds()
        labels = merging[0].seconds
        seconds = {'labels': labels, 'training and validation': time.perf_counter() - self._began - labels}
        views = merges = None
        if label_maker.task == 'segmentation':
            scenes = [*self._train_records(runner, merging[0]), *self._val_records(runner)]
            pictures = [scene_from_above(scene, label_maker.source.classes) for scene in scenes]
            views = views_of(scenes, label_maker.source.classes)
            merges = merge_report(label_maker.store, label_maker.source)
        else:
            shown = list(self._box_scenes(runner, merging[0]))
            pictures = [picture for picture, _ in shown]
            views = pack_views([view for _, view in shown], label_maker.source.classes) if shown else None
        record, classes = read_record(runner.work_dir), label_maker.source.classes
        report = run_report(runner.cfg, record, label_maker.store, classes, pictures, seconds, views, merges, times)
        path = write_report(Path(runner.work_dir) / 'report.html', report)
        runner.logger.info(f'report: {path}')

    # ------------------------------------------------------------------ detection

    def _box_scenes(self, runner: Runner, merging: RegionMergeHook) -> Iterator[tuple[Picture, SceneView]]:
        """Training scenes with their labels, validation scenes, each from above and to turn."""
        label_maker, dataset = merging.label_maker, merging.dataloader.dataset
        classes = label_maker.source.classes
        rated = sorted(label_maker.store.scenes().items(), key=lambda item: -item[1].true_boxes)
        for scene_id, _ in rated[: self.train_scenes]:
            index, labels = label_maker.index_of[scene_id], label_maker.store.read(scene_id)
            cloud, truth = label_maker.source.load_cloud(index), label_maker.source.truth(index)
            found, regions = _detect(runner, dataset[index]), label_maker.regions(scene_id)
            caption = f'training scene {scene_id}, labels of the last round'
            picture = scene_picture(caption, cloud, classes, truth, found, regions, labels)
            yield picture, _view(caption, cloud, classes, truth, found, labels.boxes)
        for dataset, index in self._val_scenes(runner):
            cloud, truth = dataset.load_cloud(index), dataset.load_truth(index)
            caption, found = f'validation scene {dataset.scene_ids[index]}', _detect(runner, dataset[index])
            yield scene_picture(caption, cloud, classes, truth, found), _view(caption, cloud, classes, truth, found)

    def _val_scenes(self, runner: Runner) -> Iterator[tuple[Any, int]]:
        if runner.val_loop is None:
            return
        dataset = runner.val_dataloader.dataset
        step = max(1, len(dataset) // max(self.val_scenes, 1))
        for index in list(range(0, len(dataset), step))[: self.val_scenes]:
            yield dataset, index

    # ------------------------------------------------------------------ segmentation

    def _train_records(self, runner: Runner, merging: RegionMergeHook) -> Iterator[SceneRecord]:
        label_maker, dataset = merging.label_maker, merging.dataloader.dataset
        for scene_id in pick_scenes(label_maker, self.train_scenes):
            index = label_maker.index_of[scene_id]
            cloud, truth = label_maker.source.load_cloud(index), label_maker.source.truth(index)
            regions = label_maker.regions(scene_id)
            classes, instances = _segment(runner, dataset[dataset.scene_ids.index(scene_id)], len(cloud))
            yield SceneRecord(
                f'training scene {scene_id}',
                cloud,
                None if regions is None else regions.labels,
                {number: label_maker.store.read(scene_id, number) for number in label_maker.store.rounds()},
                classes,
                instances,
                None if truth is None else truth.semantic,
                None if truth is None else truth.instance,
            )

    def _val_records(self, runner: Runner) -> Iterator[SceneRecord]:
        for dataset, index in self._val_scenes(runner):
            cloud = dataset.load_cloud(index)
            truth = dataset.load_truth(index) if dataset.labels == 'truth' else None  # else nobody may know it
            classes, instances = _segment(runner, dataset[index], len(cloud))
            yield SceneRecord(
                f'validation scene {dataset.scene_ids[index]}',
                cloud,
                predicted=classes,
                instances=instances,
                truth=None if truth is None else truth.semantic,
                true_instances=None if truth is None else truth.instance,
            )


_DRAWN = ('scene_ids', 'load_cloud', 'load_truth', 'metainfo', 'labels')  # what is asked of a validation data set


def _merging(runner: Runner) -> list[RegionMergeHook]:
    return [hook for hook in runner.hooks if isinstance(hook, RegionMergeHook)]


def _need(dataset: Any, names: tuple[str, ...], option: str) -> None:
    if missing := [name for name in names if not hasattr(dataset, name)]:
        raise ConfigError(
            f'ReportHook: {type(dataset).__name__} has no {", ".join(missing)}, so its scenes cannot be drawn; make it '
            f'a SceneDataset (rm3d_plugin.datasets), or set {option}=0'
        )


def _predict(runner: Runner, item: dict[str, Any]) -> Any:
    model = getattr(runner.model, 'module', runner.model)
    model.eval()
    with torch.no_grad():
        return model.test_step(pseudo_collate([item]))[0]


def _detect(runner: Runner, item: dict[str, Any], min_score: float = 0.3) -> Boxes3D:
    sample = _predict(runner, item)
    if 'pred_bboxes_3d' not in sample:
        raise SceneError(f'ReportHook: the prediction of scene {sample.get("scene_id")} has no pred_bboxes_3d')
    fields = (sample.pred_bboxes_3d, sample.pred_labels_3d, sample.pred_scores_3d)
    boxes, labels, scores = map(numpy_of, fields)
    return Boxes3D(boxes, labels, scores).select(scores >= min_score)


def _view(
    caption: str,
    cloud: PointCloud,
    classes: Sequence[str],
    truth: Truth | None,
    found: Boxes3D,
    labels: Boxes3D | None = None,
) -> SceneView:
    known = {} if truth is None else {TRUTH: truth.boxes}
    pseudo = {} if labels is None else {'pseudo labels': labels}
    return box_view(caption, cloud, {**known, **pseudo, 'predicted': found}, classes)


def _segment(runner: Runner, item: dict[str, Any], points: int) -> tuple[np.ndarray, np.ndarray | None]:
    """Class and instance of every point of a scene, -1 = none; no instances where the model looks for none."""
    sample = _predict(runner, item)
    if 'pred_point_probs' not in sample:
        raise SceneError(f'ReportHook: the prediction of scene {sample.get("scene_id")} has no pred_point_probs')
    index = numpy_of(sample.point_index) if 'point_index' in sample else None
    classes = point_classes(numpy_of(sample.pred_point_probs), index, points)
    if 'pred_instance_masks' not in sample:
        return classes, None
    masks, scores = numpy_of(sample.pred_instance_masks), numpy_of(sample.pred_instance_scores)
    return classes, point_instances(masks, scores, index, points)
