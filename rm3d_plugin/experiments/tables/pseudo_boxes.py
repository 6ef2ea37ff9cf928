"""Pseudo boxes rule by rule, all from one network: how many, how many are right, how many are found."""

import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import torch
from mmengine.dataset import pseudo_collate

from rm3d_plugin.engine.hooks.safe_checkpoint_hook import checkpoints
from rm3d_plugin.engine.run import label_hooks
from rm3d_plugin.engine.scene_prediction import scene_prediction
from rm3d_plugin.experiments.render import Cell, FilledTable, NamedRow, Section, bar_figure
from rm3d_plugin.experiments.runner import Commands, run_folder, run_rows
from rm3d_plugin.experiments.scale import scaled_row
from rm3d_plugin.experiments.spec import Request, Row
from rm3d_plugin.inference.trained import TrainedNetwork, load_network
from rm3d_plugin.labeling import LabelMaker
from rm3d_plugin.pseudo_labels import PointPrediction
from rm3d_plugin.registry import DATASETS, TASK_UTILS

ALONE = 'sup_votenet_kitti_1pct'  # trained on annotated boxes alone: its network makes the labels of round 1
SMALL = {  # the network of the demo, for real frames
    'voxel_size': 0.15, 'widths': [16, 32, 48, 64], 'blocks': 1, 'num_seeds': 512, 'num_proposals': 128, 'hidden': 64,
    'rounds': 10, 'warm_up_rounds': 6, 'learning_rate': 2e-3, 'val_rounds': 10,
}  # fmt: skip
TRAINED = Row('labelled boxes alone', ALONE)
HEADS = ('pseudo boxes', 'right', 'hidden')


class Rule(NamedTuple):
    """How labels are made.

    Attributes:
        teacher: Rules of predicted boxes that differ from those of the run; None: groups of regions become boxes.
        all_views: Whether scenes are seen in all the test views.
    """

    teacher: Mapping[str, Any] | None
    all_views: bool = True


RULES = {
    'groups of regions, best 40 % of each class, one view': Rule(None, all_views=False),
    'groups of regions, all views': Rule(None),
    'predicted boxes, one view': Rule({'recognised': 0.0}, all_views=False),
    'predicted boxes, all views': Rule({'recognised': 0.0}),
    'the same, of classes whose annotated objects are recognised (the default)': Rule({}),
    'boxes around the instances of points and votes': Rule({'source': 'instances'}),
    'boxes around clusters above the ground': Rule({'source': 'clusters'}),
    'the default, whatever is above': Rule({'free_above': 0.0}),
    'the default, of any height': Rule({'top': 0.0}),
    'the default, however high they say they are': Rule({'seen_height': 0.0}),
    'the default, as high as the lowest annotated box of the class besides': Rule({'lowest': 0.95}),
    'the default, looks are not asked': Rule({'least_likeness': 0.0}),
    'the default, from half of the usual score on': Rule({'share': 0.5}),
}


class BoxCounts(NamedTuple):
    """Of one rule, class and seed.

    Attributes:
        pseudo: Pseudo boxes.
        right: Those that overlap a hidden box of the class by .25 or more, from above; each hidden box counts once.
        hidden: Boxes that the budget hides.
    """

    seed: int
    rule: str
    name: str
    pseudo: int
    right: int
    hidden: int


def trained_row(request: Request) -> Row:
    """What is trained: on the demo's streets, or on the folder of KITTI that ``data_root`` names."""
    if request.data_root is None:
        return scaled_row(TRAINED, request.scale)
    return Row('labelled boxes alone', ALONE, {**SMALL, 'data_root': str(request.data_root)}, train=())


def pseudo_box_table(request: Request, commands: Commands | None = None) -> FilledTable:
    """Train on annotated boxes alone, then make the labels of round 1 by every rule, and count.

    Args:
        request: Its ``options`` are those of the training, its ``seed`` draws the budget.
        commands: What trains.

    Raises:
        ConfigError: The run failed.
    """
    row = trained_row(request)
    run_rows([row], replace(request, seeds=(request.seed,)), commands)
    folder = run_folder(request.out, row, request.seed)
    return fill_counts(list(count_rules(folder, request.seed)))


def count_rules(folder: Path, seed: int) -> Iterator[BoxCounts]:
    """Counts of every rule and class, from the last network of a run."""
    network = load_network(list(checkpoints(folder).values())[-1])
    dataset = DATASETS.build(network.config.label_dataloader.dataset)
    network.model.predict_points = True
    seen: dict[bool, list[tuple[str, PointPrediction]]] = {}
    views = network.model.tta_views
    for name, rule in RULES.items():
        if rule.all_views not in seen:
            network.model.tta_views = views if rule.all_views else views[:1]
            seen[rule.all_views] = predictions(network, dataset)
        for kind, boxes in summary_of_rule(network, folder, rule, seen[rule.all_views])['boxes'].items():
            hidden = boxes['true'] - boxes['annotated']
            yield BoxCounts(seed, name, kind, boxes['pseudo'], boxes['correct'], hidden)


def predictions(network: TrainedNetwork, dataset: Any) -> list[tuple[str, PointPrediction]]:
    """What the network says of each scene."""
    with torch.no_grad():
        said = [network.model.test_step(pseudo_collate([dataset[index]])) for index in range(len(dataset))]
    return [scene_prediction(sample) for (sample,) in said]


def summary_of_rule(
    network: TrainedNetwork, folder: Path, rule: Rule, seen: Sequence[tuple[str, PointPrediction]]
) -> dict[str, Any]:
    """What the label maker says of the labels of round 1; nothing of the run is changed."""
    (hook,) = label_hooks(network.config, 'there are no labels to make')
    with tempfile.TemporaryDirectory() as store:
        teacher = None if rule.teacher is None else {**(hook.label_maker.get('teacher') or {}), **rule.teacher}
        merge = {**hook.label_maker['merge'], 'rounds': 2}  # the run's own labels were the first alone
        fields = {**hook.label_maker, 'store': store, 'teacher': teacher, 'merge': merge}
        maker: LabelMaker = TASK_UTILS.build(fields)
        maker.source.open(folder / 'labels', resume=True)
        maker.make_first_labels()
        maker.store.finish_round(0)
        maker.begin(1)
        maker.refresh_all(1, iter(seen))
        return maker.evaluate(1)


def fill_counts(counts: Sequence[BoxCounts]) -> FilledTable:
    """A row a rule, three columns a class."""
    names = list(dict.fromkeys(count.name for count in counts))
    rows = []
    for rule in dict.fromkeys(count.rule for count in counts):
        own = {count.name: count for count in counts if count.rule == rule}
        cells = (Cell(str(value), (value,)) for name in names for value in own[name][3:])
        rows.append(NamedRow(rule, tuple(cells)))
    heads = tuple(f'{name}: {what}' for name in names for what in HEADS)
    section = Section('', ('labels of round 1', *heads), tuple(rows))
    return FilledTable(
        title='Pseudo boxes by rule, from one network that learnt the annotated boxes alone',
        notes=('Right: overlap from above of at least .25 with a hidden box of the class, each hidden box once.',),
        sections=(section,),
        records=tuple(count._asdict() for count in counts),
        figure=lambda: bar_figure([section], len(heads), 'boxes'),
    )
