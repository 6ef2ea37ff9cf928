"""The compared methods: one network, one label budget, one schedule. Rows follow from the registry of baselines."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from rm3d_plugin.baselines import COMBINATIONS, FULL_SUPERVISION, LABELLED_ONLY, METHODS, Baseline, Task
from rm3d_plugin.experiments.spec import BUDGETS, DEMO, Row, Table
from rm3d_plugin.experiments.tables.paper_rows import with_budget
from rm3d_plugin.experiments.tables.published import paper_gain, published_gain

KNOWN_INSTANCES = {  # where whole scenes are annotated, offsets are learnt
    'dice_loss': '${instance_dice}',
    'offset_weight': 1.0,
    'point_group.proposals.coordinates': 'both',
}


class Setting(NamedTuple):
    """What the rows of one budget share.

    Attributes:
        table: Key in the tables of published gains, before the budget.
        task: sem, ins or votenet.
        data: Data set, as configs name it.
        budget: Label budget.
    """

    table: str
    task: Task
    data: str
    budget: str

    @property
    def key(self) -> str:
        """Of published gains."""
        return f'{self.table} {self.budget}'

    def named(self, title: str) -> str:
        """Name of a row."""
        return f'{title} ({BUDGETS[self.budget]})'

    def leaf(self, prefix: str) -> tuple[str, dict[str, Any]]:
        """Name of a config, and what differs from it: the budget, and what whole scenes teach the compared methods."""
        config, options = with_budget(f'{prefix}_{self.task}_{self.data}_{{budget}}', self.task, self.budget)
        known = self.task == 'ins' and self.budget.startswith('scenes') and not prefix.startswith('rm3d')
        return config, {**options, **KNOWN_INSTANCES} if known else options


def setting_rows(setting: Setting, train: tuple[str, ...] = DEMO) -> tuple[Row, ...]:
    """The labels alone, every method that has the task, RM3D as in the paper, RM3D, and RM3D with what helps."""
    weak = setting.named(LABELLED_ONLY.row(setting.task))
    methods = [method for method in METHODS if setting.task in method.options]
    rows = [Row(weak, *setting.leaf('sup'), train)]
    rows += [_row(setting, method.name, method.row(setting.task), method.name, {}, train) for method in methods]
    for title, further in (('RM3D as in the paper', {'strategy': 'paper'}), ('RM3D', {})):
        rows.append(_row(setting, 'rm3d', title, 'rm3d', further, train))
    rows += [
        _row(setting, f'rm3d_{both.name}', both.row(setting.task), f'rm3d_{both.name}', {}, train)
        for both in _both(setting)
    ]
    return tuple(rows)


def _both(setting: Setting) -> list[Baseline]:
    return [both for both in COMBINATIONS if setting.task in both.options and setting.data == 'scannet']


def _row(
    setting: Setting, method: str, title: str, prefix: str, further: Mapping[str, Any], train: tuple[str, ...]
) -> Row:
    config, options = setting.leaf(prefix)
    return Row(
        setting.named(title),
        config,
        {**options, **further},
        train,
        against=setting.named(LABELLED_ONLY.row(setting.task)),
        paper_gain=paper_gain(setting.key, method),
        published_gain=published_gain(setting.key, method),
    )


def methods_table(
    title: str, settings: Sequence[Setting], scores: Mapping[str, str], full: bool = True, labels: bool = False
) -> Table:
    """A table of all methods for some budgets.

    Args:
        title: One line.
        settings: From the top; of one task and data set.
        scores: Heading -> key of the run's final scores; gains are of the last.
        full: Whether full supervision stands below.
        labels: Tell what became of the labels.
    """
    first = settings[0]
    train = () if first.data == 'oakland' else DEMO
    rows = [row for setting in settings for row in setting_rows(setting, train)]
    whole = FULL_SUPERVISION.row(first.task) if full else None
    if whole is not None:
        rows.append(Row(whole, FULL_SUPERVISION.config(first.task, first.data, ''), train=train))
    return Table(title, tuple(rows), scores, reference=whole, labels=labels, cost=True)


INDOOR, INDOOR_ONE_POINT = (
    methods_table(
        'Compared methods on synthetic rooms: mIoU, in percent',
        [Setting('indoor', 'sem', 'scannet', budget)],
        {'mIoU': 'mIoU'},
    )
    for budget in ('0p2pct', 'onept')
)
OUTDOOR = methods_table(
    'Compared methods on synthetic streets: mIoU, in percent',
    [Setting('outdoor', 'sem', 'semantickitti', '0p2pct')],
    {'mIoU': 'mIoU'},
)
OAKLAND = methods_table(
    'Compared methods on Oakland: mIoU, in percent (real data: --cfg-options data_root=FOLDER)',
    [Setting('oakland', 'sem', 'oakland', '1pct')],
    {'mIoU': 'mIoU'},
    full=False,
)
INSTANCES = methods_table(
    'Compared methods on synthetic rooms: instances, in percent',
    [Setting('instances', 'ins', 'scannet', '0p2pct')],
    {'mIoU': 'mIoU', 'AP': 'AP', 'AP25': 'AP25', 'AP50': 'AP50'},
)
DETECTION = methods_table(
    'Compared methods on synthetic streets: 3D AP (moderate, R40), IoU .5 for cars, .25 for pedestrians and cyclists',
    [Setting('detection', 'votenet', 'kitti', '1pct')],
    {
        'Car': 'Car_3d_moderate_R40@0.50',
        'Cyclist': 'Cyclist_3d_moderate_R40@0.25',
        'mean': 'mAP_3d_moderate_R40_loose',
        'Pedestrian': 'Pedestrian_3d_moderate_R40@0.25',
    },
)
SCENES = methods_table(
    'Compared methods on synthetic rooms, some of them annotated whole: instances, in percent',
    [Setting('scenes', 'ins', 'scannet', budget) for budget in ('scenes5pct', 'scenes20pct')],
    {'mIoU': 'mIoU', 'AP': 'AP', 'AP25': 'AP25', 'AP50': 'AP50'},
)
