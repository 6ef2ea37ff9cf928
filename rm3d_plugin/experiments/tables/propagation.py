"""Label propagation within one scan: a few labelled points of each class, scored on all others of the same scan."""

import shutil
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Int
from mmengine.config import Config
from mmengine.registry import init_default_scope
from scipy.spatial import cKDTree

from rm3d_plugin.baselines import LABELLED_ONLY
from rm3d_plugin.engine.config import ConfigError, load_config
from rm3d_plugin.engine.config_errors import config_errors
from rm3d_plugin.evaluation.functional.semantic_iou import confusion_counts, semantic_scores
from rm3d_plugin.experiments.benchmarks.propagate_clicks import plain_walker, walked
from rm3d_plugin.experiments.render import Cell, FilledTable, NamedRow, Section, bar_figure
from rm3d_plugin.experiments.run_commands import config_path, parse_options
from rm3d_plugin.experiments.runner import Commands, final_scores, plan, run_folder, run_rows
from rm3d_plugin.experiments.scenes import real_root
from rm3d_plugin.experiments.spec import Request, Row
from rm3d_plugin.pseudo_labels.propagation import prepare_cloud, propagate_prepared
from rm3d_plugin.registry import DATASETS, SCOPE
from rm3d_plugin.storage import LabelStore, write_text
from rm3d_plugin.structures import UNLABELLED, PointCloud

BUDGET = '20pts_class'  # at most so many points of a class
SEQUENCE = 0  # under which a single SemanticKITTI scan is laid out
OWN_SCANS = 'rm3d_sem_files_streets_clicks'  # the leaf whose settings every scan gets
SETTINGS = """
    rounds sigma periods restart_weights learning_rate checkpoint_interval train_pipeline eval_pipeline crop_points
    point_columns voxel_size widths blocks class_power oversegmenter batch_size tta_rotations superpoint_smoothing
    logit_adjustment strategy walker random_walk merge propagation region_prior ground self_training
""".split()  # of those that are about scans with few labels, not about a data set
SCORED = [
    {'type': 'UnlabelledSemSegMetric', 'label_store': '${work_dir}/labels', 'keep_labels': True},
    {'type': 'UnlabelledSemSegMetric', 'label_store': '${work_dir}/labels', 'prefix': 'network'},
]


@dataclass(frozen=True)
class Scan:
    """One real scan, and how a config comes to learn from it alone.

    Attributes:
        name: Row of the table.
        config: Name of a leaf that reads the data set.
        options: Config keys that name the scan.
    """

    name: str
    config: str
    options: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class PropagationScores:
    """mIoU on the unlabelled points of one scan, percent.

    Attributes:
        labelled_only: Network trained on the labelled points alone.
        nearest: Every point as the labelled point nearest to it.
        walker: A plain random walker from the labelled points, with fixed scales.
        solver: What ``rm3d label`` writes: the propagation of the labelled points, no training.
        paper_first: RM3D as in the paper before training: labels of round 0, the other points as the nearest that has
            one.
        paper_network: Network trained by RM3D as in the paper.
        paper: RM3D as in the paper: points with a label in the last round have it, the network says what the others
            are.
        paper_filled: The same labels, and the others as the nearest point that has one.
        first: RM3D before training: labels of round 0, points without one are wrong.
        first_filled: The same labels, the other points as the nearest that has one.
        network: Network trained by RM3D.
        rm3d: RM3D: points with a label in the last round have it, the others what it finds likeliest.
        rm3d_filled: The same labels, and the others as the nearest point that has one.
    """

    labelled_only: float
    nearest: float
    walker: float
    solver: float
    paper_first: float
    paper_network: float
    paper: float
    paper_filled: float
    first: float
    first_filled: float
    network: float
    rm3d: float
    rm3d_filled: float


COLUMNS = {
    'labelled_only': 'network on the labelled points alone',
    'nearest': 'nearest labelled point',
    'walker': 'plain random walker',
    'solver': 'rm3d label',
    'paper_first': "the paper's labels of round 0, the rest as the nearest",
    'paper_network': "the paper's network",
    'paper': "the paper's labels, the rest by its network",
    'paper_filled': "the paper's labels, the rest as the nearest",
    'first': "RM3D's labels of round 0, the rest wrong",
    'first_filled': "RM3D's labels of round 0, the rest as the nearest",
    'network': "RM3D's network",
    'rm3d': "RM3D's labels, the rest as it finds likeliest",
    'rm3d_filled': "RM3D's labels, the rest as the nearest",
}


METHODS: dict[str, tuple[str | None, str | None, str | None]] = {
    'nearest labelled point': (None, None, 'nearest'),
    'plain random walker': (None, None, 'walker'),
    'rm3d label': (None, None, 'solver'),
    'labelled points alone': ('labelled_only', None, None),
    'RM3D as in the paper, round 0': (None, None, 'paper_first'),
    'RM3D as in the paper': ('paper_network', 'paper', 'paper_filled'),
    'RM3D, round 0': (None, None, 'first_filled'),
    'RM3D': ('network', 'rm3d', 'rm3d_filled'),
}
"""Row -> columns of its network alone, of its labels filled by the network, and of labels of all points."""


def oakland_scans(root: Path) -> list[Scan]:
    """Every Oakland tile of a folder."""
    tiles = sorted(path.stem.removeprefix('oakland_') for path in root.glob('*.xyz_label_conf'))
    common = {'data_root': str(root)}
    return [
        Scan(f'Oakland {tile}', 'rm3d_sem_oakland_1pct', common | {'train_tiles': [tile], 'val_tiles': [tile]})
        for tile in tiles
    ]


def semantickitti_scans(root: Path, out: Path) -> list[Scan]:
    """Every labelled SemanticKITTI scan of a folder, each copied into a data set of its own under ``out``."""
    scans: list[Scan] = []
    for labels in sorted(root.glob('sequences/*/labels/*.label')):
        sequence, number = labels.parent.parent, labels.stem
        alone = out / f'{sequence.name}_{number}'
        for part, ending in (('velodyne', '.bin'), ('labels', '.label')):
            target = alone / 'sequences' / f'{SEQUENCE:02d}' / part / f'{number}{ending}'
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(sequence / part / f'{number}{ending}', target)
        options: dict[str, Any] = {'data_root': str(alone), 'train_sequences': [SEQUENCE], 'val_sequences': [SEQUENCE]}
        if _has_remission(sequence / 'velodyne' / f'{number}.bin'):
            options |= {'use_intensity': True, 'point_columns': ['intensity', 'shape', 'place']}
        scans.append(Scan(f'SemanticKITTI {sequence.name}/{number}', 'rm3d_sem_semantickitti_few_1pct', options))
    return scans


def _has_remission(scan: Path) -> bool:
    return bool(np.fromfile(scan, dtype='<f4')[3::4].any())


def scan_rows(scan: Scan, folder: Path) -> dict[str, Row]:
    """What is trained on one scan, by the column of its score; writes the config leaf into ``folder``."""
    leaf = str(write_leaf(scan, folder))
    return {
        'labelled_only': Row(f'{scan.name}: labelled points alone', leaf, LABELLED_ONLY.options['sem'], ()),
        'paper': Row(f'{scan.name}: RM3D as in the paper', leaf, {'strategy': 'paper'}, ()),
        'rm3d': Row(f'{scan.name}: RM3D', leaf, train=()),
    }


def write_leaf(scan: Scan, folder: Path) -> Path:
    """A config of one scan: the data set of its leaf, and how own scans are learnt.

    Args:
        scan: Which.
        folder: Where ``NAME.py`` is written.
    """
    own = Config.fromfile(str(config_path(OWN_SCANS)))
    keys = {name: _whole(own[name]) for name in SETTINGS}
    keys |= {'budget': BUDGET, 'val_evaluator': SCORED, 'voxel_downsample': None, **scan.options}
    plain = Config(keys).to_dict()
    lines = [
        f'# {scan.name} with the settings of {OWN_SCANS}; written by the table "propagation".',
        f'_base_ = {str(config_path(scan.config).resolve())!r}',
        *(f'{name} = {value!r}' for name, value in plain.items()),
    ]
    name = scan.name.replace(' ', '_').replace('/', '_').lower()
    return write_text(folder / f'{name}.py', '\n'.join(lines) + '\n')


def _whole(value: Any) -> Any:
    """A dict takes the place of that of the leaf, instead of being merged into it."""
    return {'_delete_': True, **value} if isinstance(value, Mapping) else value


def score_scan(scan: Scan, request: Request) -> PropagationScores:
    """Scores of the finished runs on one scan, and of what needs no network.

    Args:
        scan: Which.
        request: Folder, seed and further config keys of the runs.
    """
    rows = scan_rows(scan, request.out / 'configs')
    scores = {name: final_scores(request.out, row, request.seed) for name, row in rows.items()}
    (run,) = plan([rows['rm3d']], replace(request, seeds=(request.seed,)))
    init_default_scope(SCOPE)
    config = load_config(run.config, run.folder, options=parse_options({**run.options, 'seed': str(run.seed)}))
    paper = run_folder(request.out, rows['paper'], request.seed)
    return PropagationScores(
        labelled_only=scores['labelled_only']['mIoU'],
        paper=scores['paper']['mIoU'],
        paper_network=scores['paper']['network/mIoU'],
        network=scores['rm3d']['network/mIoU'],
        rm3d=scores['rm3d']['mIoU'],
        **labels_alone(config, run.folder, paper),
    )


def labels_alone(config: Any, work_dir: Path, paper: Path) -> dict[str, float]:
    """Score (mIoU, percent) of labels where no network is asked in the end, by column of :class:`PropagationScores`.

    Args:
        config: Of a run whose scenes are scored.
        work_dir: Its folder; round 0 of its labels asks no network, and only the last is told every annotated point.
        paper: Folder of the run with the paper's strategy.
    """
    with config_errors(config):
        dataset = DATASETS.build({**config.val_dataloader.dataset, 'pipeline': []})
    store, theirs, classes = LabelStore(work_dir / 'labels'), LabelStore(paper / 'labels'), len(dataset.classes)
    counts: dict[str, np.ndarray] = {}
    for index, scene in enumerate(dataset.scene_ids):
        first, last, cloud = store.read(scene, 0), store.read(scene, store.rounds()[-1]), dataset.load_cloud(index)
        hidden = np.where(last.point_is_annotated, UNLABELLED, dataset.load_truth(index).semantic)
        annotated = np.where(last.point_is_annotated, last.semantic, UNLABELLED)
        said = {
            **without_training(cloud, annotated, classes),
            'paper_first': _nearest(cloud.xyz, theirs.read(scene, 0).semantic),
            'paper_filled': _nearest(cloud.xyz, theirs.read(scene, theirs.rounds()[-1]).semantic),
            'first': first.semantic,
            'first_filled': _nearest(cloud.xyz, first.semantic),
            'rm3d_filled': _nearest(cloud.xyz, last.semantic),
        }
        for name, rows in said.items():
            counts[name] = counts.get(name, 0) + confusion_counts(rows, hidden, classes)
    return {name: 100 * float(semantic_scores(count).mean_iou) for name, count in counts.items()}


def without_training(
    cloud: PointCloud, annotated: Int[np.ndarray, ' points'], classes: int
) -> dict[str, Int[np.ndarray, ' points']]:
    """What each point is called from the labelled ones and the scan alone, by column."""
    labelled, scene = np.flatnonzero(annotated >= 0), prepare_cloud(cloud)
    return {
        'nearest': _nearest(cloud.xyz, annotated),
        'walker': walked(plain_walker(scene), labelled, annotated[labelled]),
        'solver': propagate_prepared(scene, annotated, classes).semantic,
    }


def _nearest(xyz: np.ndarray, semantic: Int[np.ndarray, ' points']) -> Int[np.ndarray, ' points']:
    """Unlabelled points take the class of the nearest labelled one."""
    known, rest = np.flatnonzero(semantic >= 0), np.flatnonzero(semantic < 0)
    out = semantic.copy()
    if len(known):
        out[rest] = semantic[known[cKDTree(xyz[known]).query(xyz[rest])[1]]]
    return out


def propagation_table(request: Request, commands: Commands | None = None) -> FilledTable:
    """Train on every real scan that is there by itself, and score it.

    Args:
        request: Its ``data_root`` holds ``oakland`` or ``semantickitti`` (default: environment variable
            RM3D_REAL_DATA); ``scenes`` of each are taken, at most, whole.
        commands: What trains.

    Raises:
        ConfigError: There are no real scans, or a run failed.
    """
    root = request.data_root or real_root()
    scans = oakland_scans(root / 'oakland')[: request.scenes]
    scans += semantickitti_scans(root / 'semantickitti', request.out / 'scans')[: request.scenes]
    if not scans:
        raise ConfigError(f'{root}: no oakland/*.xyz_label_conf, no semantickitti/sequences; name their folder')
    rows = [row for scan in scans for row in scan_rows(scan, request.out / 'configs').values()]
    run_rows(rows, replace(request, seeds=(request.seed,)), commands)
    return fill_propagation({scan.name: score_scan(scan, request) for scan in scans}, request.seed)


def fill_propagation(scores: Mapping[str, PropagationScores], seed: int) -> FilledTable:
    """A row a scan, and their mean."""
    found = {name: asdict(row) for name, row in scores.items()}
    means = {name: float(np.mean([row[name] for row in found.values()])) for name in COLUMNS}
    rows = tuple(
        NamedRow(name, tuple(Cell(f'{row[column]:.1f}', (row[column],)) for column in COLUMNS))
        for name, row in [*found.items(), ('mean', means)]
    )
    section = Section('Each scan', ('scan', *COLUMNS.values()), rows)
    return FilledTable(
        title=f'mIoU (%) on the unlabelled points of the same scan; at most 20 labelled points a class, seed {seed}',
        notes=(),
        sections=(method_section(means), section),
        records=tuple({'scan': name, 'seed': seed, **row} for name, row in found.items()),
        figure=lambda: bar_figure([section], len(COLUMNS), 'mIoU, percent'),
    )


def method_section(means: Mapping[str, float]) -> Section:
    """A row a method, both strategies among them.

    Args:
        means: Over the scans, by column of :class:`PropagationScores`.
    """
    rows = tuple(
        NamedRow(name, tuple(Cell('-') if key is None else Cell(f'{means[key]:.1f}', (means[key],)) for key in keys))
        for name, keys in METHODS.items()
    )
    heads = ('network alone', 'labels, the rest as the run says', 'labels, the rest as the nearest')
    return Section('Mean of the scans', ('method', *heads), rows)
