"""Training sees what the budget shows and nothing else: noise in everything hidden changes no bit (METHOD 8)."""

import json
import shutil
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import torch
from runs import tiny_runs

from rm3d_plugin.label_budgets import load_box_budget
from rm3d_plugin.storage import LabelStore

BUDGET = {'_delete_': True, 'per_scene': 1.0}


def train_blind(work_dir: Path, settings: dict, budget_file: Path) -> None:
    """Train with the given draw on training scenes whose hidden truth is noise."""
    from rm3d_plugin.datasets import KittiDataset
    from rm3d_plugin.label_budgets import save_box_budget, scramble_hidden
    from rm3d_plugin.registry import DATASETS

    budget = load_box_budget(budget_file)

    @DATASETS.register_module()
    class ScrambledKitti(KittiDataset):
        def load_truth(self, index):
            truth, scene = super().load_truth(index), self.scene_ids[index]
            return scramble_hidden(truth, budget.rows(scene, len(truth.boxes)), np.random.default_rng([9, index]))

    tiny_runs.train(work_dir, settings, change=partial(_use_draw, budget, save_box_budget, 'ScrambledKitti'))


def train_drawn(work_dir: Path, settings: dict, budget_file: Path) -> None:
    """Train with the given draw."""
    from rm3d_plugin.label_budgets import save_box_budget

    budget = load_box_budget(budget_file)
    tiny_runs.train(work_dir, settings, change=partial(_use_draw, budget, save_box_budget, 'KittiDataset'))


def _use_draw(budget, save, dataset_type, config) -> None:
    from rm3d_plugin.labeling.sources import BoxBudgetSource

    def open_drawn(self, folder, resume):
        self._budget = budget
        save(folder / 'budget.json', budget)

    BoxBudgetSource.open = open_drawn
    merge = next(hook for hook in config.custom_hooks if hook.type == 'RegionMergeHook')
    for dataset in (config.train_dataloader.dataset, merge.dataloader.dataset, merge.label_maker.source.dataset):
        dataset.type = dataset_type


@pytest.fixture(scope='module')
def drawn(world, tmp_path_factory):
    """A run with one annotated box a scene, on the true data."""
    base = tmp_path_factory.mktemp('drawn')
    code, log = tiny_runs.run(base / 'log.txt', tiny_runs.train, base / 'run', tiny_runs.options(world, budget=BUDGET))
    assert code == 0, log
    budget = load_box_budget(base / 'run' / 'labels' / 'budget.json')
    assert budget.annotated_count == 3 < sum(budget.total_per_class.values())
    return base / 'run'


def assert_same_learning(folder: Path, other: Path) -> None:
    assert (folder / 'metrics.json').read_bytes() == (other / 'metrics.json').read_bytes()
    ours, theirs = (torch.load(f / 'epoch_2.pth', weights_only=True)['state_dict'] for f in (folder, other))
    for name in ours:
        assert torch.equal(ours[name], theirs[name]), name
    stored = sorted(path.relative_to(folder) for path in (folder / 'labels').rglob('*.npz'))
    assert len(stored) >= 6
    for name in stored:
        assert (folder / name).read_bytes() == (other / name).read_bytes(), name


def test_scrambled_hidden_truth_changes_nothing(world, drawn, tmp_path):
    budget_file = drawn / 'labels' / 'budget.json'
    settings = tiny_runs.options(world, budget=BUDGET)
    code, log = tiny_runs.run(tmp_path / 'log.txt', train_blind, tmp_path / 'run', settings, budget_file)
    assert code == 0, log
    assert_same_learning(tmp_path / 'run', drawn)
    summaries = [LabelStore(folder / 'labels').summary(1) for folder in (tmp_path / 'run', drawn)]
    assert summaries[0] != summaries[1], 'the report on the labels must have met the noise, or this test proves nothing'


def test_scrambled_annotated_boxes_change_the_run(world, drawn, tmp_path):
    """The other way round: what is annotated does reach training."""
    noisy = shutil.copytree(world, tmp_path / 'noisy' / 'kitti')
    for path in (noisy / 'training' / 'label_2').glob('*.txt'):
        words = [line.split() for line in path.read_text().splitlines()]
        path.write_text(''.join(' '.join([*w[:8], '2.22', '2.22', '2.22', *w[11:]]) + '\n' for w in words))
    settings = tiny_runs.options(world, budget=BUDGET, data_root=str(noisy))
    budget_file = drawn / 'labels' / 'budget.json'
    code, log = tiny_runs.run(tmp_path / 'log.txt', train_drawn, tmp_path / 'run', settings, budget_file)
    assert code == 0, log
    ours, theirs = (json.loads((f / 'metrics.json').read_text())['losses'] for f in (tmp_path / 'run', drawn))
    assert ours != theirs


def test_label_files_of_frames_without_a_annotated_box_may_hold_anything(world, finished, tmp_path):
    budget_file = finished.folder / 'labels' / 'budget.json'
    budget = load_box_budget(budget_file)
    noisy = shutil.copytree(world, tmp_path / 'noisy' / 'kitti')
    hidden = [scene for scene, rows in budget.annotated.items() if not rows]
    assert len(hidden) == 2
    rng = np.random.default_rng(3)
    for scene in hidden:
        lines = [noise_line(rng) for _ in range(budget.boxes_per_scene[scene])]
        (noisy / 'training' / 'label_2' / f'{scene}.txt').write_text('\n'.join(lines) + '\n')
    settings = tiny_runs.options(world, data_root=str(noisy))
    code, log = tiny_runs.run(tmp_path / 'log.txt', train_drawn, tmp_path / 'run', settings, budget_file)
    assert code == 0, log
    assert_same_learning(tmp_path / 'run', finished.folder)


def noise_line(rng: np.random.Generator) -> str:
    """A made-up object in range."""
    kind = ('Car', 'Pedestrian', 'Cyclist')[rng.integers(3)]
    size, side, ahead = rng.uniform(0.3, 6, 3), rng.uniform(-20, 20), rng.uniform(5, 60)
    numbers = [0, 0, 0, 0, 0, 50, 50, *size, side, 1.5, ahead, rng.uniform(-3, 3)]
    return ' '.join([kind, *(f'{number:.2f}' if i != 1 else '0' for i, number in enumerate(numbers))])
