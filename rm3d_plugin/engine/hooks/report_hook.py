"""Leaves ``report.html`` in the work directory."""

import time
from pathlib import Path
from typing import Any

import torch
from mmengine.dataset import pseudo_collate
from mmengine.dist import is_main_process
from mmengine.hooks import Hook
from mmengine.runner import Runner

from rm3d_plugin.engine.hooks.region_merge_hook import RegionMergeHook
from rm3d_plugin.engine.hooks.run_record_hook import read_record
from rm3d_plugin.engine.report import run_report, scene_picture
from rm3d_plugin.registry import HOOKS
from rm3d_plugin.structures import Boxes3D
from rm3d_plugin.visualization import Picture, write_report


@HOOKS.register_module()
class ReportHook(Hook):
    """After training: one self-contained page with scores, curves, labels of each round and pictures.

    Args:
        train_scenes: How many training scenes are shown with regions, pseudo labels and predictions.
        val_scenes: How many validation scenes are shown with predictions.
    """

    priority = 'VERY_LOW'

    def __init__(self, train_scenes: int = 2, val_scenes: int = 2) -> None:
        self.train_scenes, self.val_scenes = train_scenes, val_scenes
        self._began = time.perf_counter()

    def before_train(self, runner: Runner) -> None:
        """Start the clock of this process."""
        self._began = time.perf_counter()

    def after_train(self, runner: Runner) -> None:
        """Write the page."""
        merging = [hook for hook in runner.hooks if isinstance(hook, RegionMergeHook)]
        if not is_main_process() or not merging:
            return
        labeler = merging[0].labeler
        seconds = {'training, this process': time.perf_counter() - self._began, 'of it labels': merging[0].seconds}
        pictures = [*self._train_pictures(runner, merging[0]), *self._val_pictures(runner)]
        record = read_record(runner.work_dir)
        report = run_report(runner.cfg, record, labeler.store, labeler.source.classes, pictures, seconds)
        path = write_report(Path(runner.work_dir) / 'report.html', report)
        runner.logger.info(f'report: {path}')

    def _train_pictures(self, runner: Runner, merging: RegionMergeHook) -> list[Picture]:
        labeler, dataset = merging.labeler, merging.dataloader.dataset
        rated = sorted(labeler.store.scenes().items(), key=lambda item: -item[1].true_boxes)
        pictures = []
        for scene_id, _ in rated[: self.train_scenes]:
            scene, index = labeler.prepared(scene_id), labeler.source.scene_ids.index(scene_id)
            pictures.append(
                scene_picture(
                    f'training scene {scene_id}, labels of the last round',
                    scene.cloud,
                    labeler.source.classes,
                    labeler.source.truth(index),
                    _detect(runner, dataset[index]),
                    scene.regions,
                    labeler.store.read(scene_id),
                )
            )
        return pictures

    def _val_pictures(self, runner: Runner) -> list[Picture]:
        if runner.val_loop is None:
            return []
        dataset = runner.val_dataloader.dataset
        step = max(1, len(dataset) // max(self.val_scenes, 1))
        return [
            scene_picture(
                f'validation scene {dataset.scene_ids[index]}',
                dataset.load_cloud(index),
                dataset.metainfo['classes'],
                dataset.load_truth(index),
                _detect(runner, dataset[index]),
            )
            for index in list(range(0, len(dataset), step))[: self.val_scenes]
        ]


def _detect(runner: Runner, item: dict[str, Any], min_score: float = 0.3) -> Boxes3D:
    model = getattr(runner.model, 'module', runner.model)
    model.eval()
    with torch.no_grad():
        sample = model.test_step(pseudo_collate([item]))[0]
    scores = sample.pred_scores_3d.cpu().numpy()
    boxes = Boxes3D(sample.pred_bboxes_3d.cpu().numpy(), sample.pred_labels_3d.cpu().numpy(), scores)
    return boxes.select(scores >= min_score)
