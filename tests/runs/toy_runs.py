"""Whole segmentation trainings on the toy rooms, each in a process of its own (see tiny_runs)."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from runs import tiny_runs

BUDGET = 'onept_instance'


def config_of(work_dir: Path, budget: Any, dataset: str = 'ToyRooms', region_prior: bool = False) -> Any:
    """Two rounds of two epochs on three rooms."""
    from mmengine.config import Config

    def loader(sampler: dict, labels: str, pipeline: list) -> dict:
        return dict(
            batch_size=1,
            num_workers=0,
            collate_fn=dict(type='pseudo_collate'),
            sampler=sampler,
            dataset=dict(type=dataset, labels=labels, label_store=f'{work_dir}/labels', pipeline=pipeline),
        )

    training = loader(
        dict(type='EpochSampler', shuffle=True), 'store', [dict(type='AugmentedView'), dict(type='PackScene')]
    )
    asking = loader(dict(type='DefaultSampler', shuffle=False), 'none', [dict(type='PackScene')])
    return Config(
        dict(
            work_dir=str(work_dir),
            default_scope='rm3d_plugin',
            train_dataloader=training,
            train_cfg=dict(type='RoundTrainLoop', rounds=2, sigma=2),
            optim_wrapper=dict(type='OptimWrapper', optimizer=dict(type='Adam', lr=0.01)),
            randomness=dict(seed=0, deterministic=True),
            default_hooks=dict(
                sampler_seed=dict(type='DistSamplerSeedHook'),
                checkpoint=dict(
                    type='CheckpointHook', interval=1, max_keep_ckpts=2, backend_args=dict(backend='rm3d_atomic')
                ),
            ),
            model=dict(
                type='RM3DSegmentor',
                num_classes=3,
                backbone=dict(type='SparseUNet', voxel_size=0.2, widths=[8, 16], blocks=1),
                instance_head=dict(),
                thing_classes=[1],
            ),
            custom_hooks=[
                dict(type='EpochSeedHook'),
                dict(
                    type='RegionMergeHook',
                    interval=2,
                    rounds=2,
                    dataloader=asking,
                    label_maker=dict(
                        type='SegmentationLabelMaker',
                        store=f'{work_dir}/labels',
                        cache=f'{work_dir}/geometry',
                        source=dict(type='PointBudgetSource', dataset=asking['dataset'], budget=budget),
                        descriptor=dict(type='AdaptedPFH', radius=0.15, max_neighbors=16),
                        oversegmenter=dict(type='RegionGrowing', threshold=0.9, max_edge=0.25, min_region=10),
                        merge=dict(rounds=2, gamma=0.4),
                        region_prior=dict() if region_prior else None,
                    ),
                ),
                dict(type='SafeCheckpointHook'),
                dict(type='RunRecordHook'),
            ],
        )
    )


def train(
    work_dir: Path,
    budget: Any = BUDGET,
    resume: bool = False,
    kill_at_refresh: int | None = None,
    kill_at_iteration: int | None = None,
    change: Callable[[], str] | None = None,
    region_prior: bool = False,
) -> None:
    """Train, three iterations an epoch; ``change`` may register another data set and give its name."""
    import torch
    from mmengine.registry import init_default_scope
    from reference.toy_scenes import ToyRooms

    import rm3d_plugin.labeling
    import rm3d_plugin.models
    from rm3d_plugin.engine.loops import RoundTrainLoop
    from rm3d_plugin.engine.run import train as train_config
    from rm3d_plugin.registry import DATASETS

    torch.set_num_threads(1)
    init_default_scope('rm3d_plugin')
    DATASETS.register_module(module=ToyRooms)
    tiny_runs._skip_pretty_printing()
    if kill_at_refresh is not None:
        tiny_runs._kill_at_call(rm3d_plugin.labeling.SegmentationLabelMaker, 'refresh', kill_at_refresh, after=True)
    if kill_at_iteration is not None:
        tiny_runs._kill_at_call(RoundTrainLoop, 'run_iter', kill_at_iteration, after=True)
    name = 'ToyRooms' if change is None else change()
    train_config(config_of(work_dir, budget, name, region_prior), resume)


def with_noise(budget_file: Path, reveal_instances: bool = True) -> str:
    """Register toy rooms whose truth is noise but where ``budget_file`` shows it, and let the runs use that draw."""
    from reference.toy_scenes import ToyRooms

    from rm3d_plugin.label_budgets import load_point_budget, save_point_budget, scramble_hidden_points
    from rm3d_plugin.labeling import PointBudgetSource
    from rm3d_plugin.registry import DATASETS

    kept = load_point_budget(budget_file)

    @DATASETS.register_module()
    class NoisyRooms(ToyRooms):
        def load_truth(self, index: int) -> Any:
            truth, scene = super().load_truth(index), self.scene_ids[index]
            rows = np.arange(len(truth.semantic)) if scene in kept.complete else kept.annotated[scene].points
            return scramble_hidden_points(truth, rows, np.random.default_rng([9, index]), reveal_instances)

    def open_kept(self: Any, folder: Path, resume: bool) -> None:
        self._budget = kept
        save_point_budget(folder / 'budget.json', kept)

    PointBudgetSource.open = open_kept
    return 'NoisyRooms'
