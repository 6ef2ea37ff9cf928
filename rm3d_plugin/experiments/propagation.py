"""Label propagation within one scan: a few labelled points of each class, scored on all others of the same scan."""

import os
import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import astuple, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Int
from mmengine.config import Config
from mmengine.registry import init_default_scope
from scipy.spatial import cKDTree

from rm3d_plugin.engine.config import ConfigError, load_config
from rm3d_plugin.engine.hooks.run_record_hook import read_record
from rm3d_plugin.engine.run import config_errors, set_threads, train
from rm3d_plugin.evaluation.functional.semantic_iou import confusion_counts, semantic_scores
from rm3d_plugin.registry import DATASETS, SCOPE
from rm3d_plugin.storage import LabelStore, write_text
from rm3d_plugin.structures import UNLABELLED

BUDGET = '20pts_class'  # at most so many points of a class
SEQUENCE = 0  # under which a single SemanticKITTI scan is laid out
CONFIGS = Path(__file__).resolve().parents[2] / 'configs'
OWN_SCANS = 'rm3d_sem_files_clicks'  # the leaf whose settings every scan gets
SETTINGS = """
    rounds sigma periods restart_weights learning_rate checkpoint_interval train_pipeline eval_pipeline crop_points
    point_columns voxel_size widths blocks class_power strategy oversegmenter batch_size votes
    superpoint_smoothing logit_adjustment
""".split()  # of those that are about scans with few labels, not about a data set
RULES = ('merge', 'propagation', 'region_prior', 'ground', 'self_training')
METHODS: dict[str, dict[str, Any]] = {'weak': {'propagate': False, 'label_refreshes': 1}, 'rm3d': {}}
SCORED = [
    {'type': 'UnlabelledSemSegMetric', 'label_store': '${work_dir}/labels', 'keep_labels': True},
    {'type': 'UnlabelledSemSegMetric', 'label_store': '${work_dir}/labels', 'prefix': 'network'},
]


@dataclass(frozen=True)
class Scan:
    """One real scan, and how a config comes to learn from it alone.

    Attributes:
        name: Row of the table.
        config: Leaf in ``configs/``.
        options: Config keys that name the scan.
    """

    name: str
    config: str
    options: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Spread:
    """mIoU on the unlabelled points of one scan, percent.

    Attributes:
        weak: Network trained on the labelled points alone.
        nearest: Every point as the labelled point nearest to it.
        regions: Regions of the labelled points, no network; what they do not reach is wrong.
        filled: The same, and what they do not reach as the nearest point that they reach.
        network: Network trained by the whole method.
        rm3d: The whole method: points with a label in the last round have it, the network says what the others are.
        spread: The same labels, and the others as the nearest point that has one.
    """

    weak: float
    nearest: float
    regions: float
    filled: float
    network: float
    rm3d: float
    spread: float


COLUMNS = {
    'weak': 'network on the labelled points alone',
    'nearest': 'nearest labelled point',
    'regions': 'regions, the rest wrong',
    'filled': 'regions, the rest as the nearest',
    'network': "RM3D's network",
    'rm3d': "RM3D's labels, the rest by its network",
    'spread': "RM3D's labels, the rest as the nearest",
}


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


def propagate(
    scan: Scan, out: Path, options: Mapping[str, Any] | None = None, log: Callable[[str], None] = print
) -> Spread:
    """Train the weak baseline and RM3D on one scan (finished runs are kept), and score them and what needs no network.

    Args:
        scan: Which.
        out: Folder of the runs.
        options: Further config keys of both runs.
        log: Told what starts.
    """
    scores = {}
    for method, settings in METHODS.items():
        work_dir = out / f'{scan.name.replace(" ", "_").replace("/", "_").lower()}_{method}'
        config = run_config(scan, work_dir, {**settings, **(options or {})})
        if not read_record(work_dir)['final']:
            log(f'{work_dir}: training')
            train(config)
        scores[method] = read_record(work_dir)['final']
    trained = {'network': scores['rm3d']['network/mIoU'], 'rm3d': scores['rm3d']['mIoU']}
    return Spread(weak=scores['weak']['mIoU'], **trained, **labels_alone(config, work_dir))


def run_config(scan: Scan, work_dir: Path, options: Mapping[str, Any]) -> Any:
    """Config of a run on one scan: the data set of its leaf, and how own scans are learnt.

    Args:
        scan: Which.
        work_dir: Of the run.
        options: Further config keys; they win.
    """
    own = Config.fromfile(str(CONFIGS / f'{OWN_SCANS}.py'))
    whole = {name: _replacing(own[name]) for name in RULES}  # nothing of the leaf's own
    keys = (
        {name: own[name] for name in SETTINGS}
        | whole
        | {
            'budget': BUDGET,
            'val_evaluator': SCORED,
            'voxel_downsample': None,
        }
    )
    init_default_scope(SCOPE)
    config = load_config(CONFIGS / f'{scan.config}.py', work_dir, options=keys | dict(scan.options) | dict(options))
    set_threads(int(config.threads))
    return config


def _replacing(rules: Mapping[str, Any] | None) -> dict[str, Any] | None:
    """Rules that take the place of those of a leaf, whatever it has."""
    return None if rules is None else {**rules, '_delete_': True}


def labels_alone(config: Any, work_dir: Path) -> dict[str, float]:
    """How good labels are where no network is asked in the end, by the columns of :class:`Spread`: mIoU in percent.

    Args:
        config: Of a run whose scenes are scored.
        work_dir: Its folder; round 0 of its labels is what regions alone say, the last is what all rounds say.
    """
    with config_errors(config):
        dataset = DATASETS.build({**config.val_dataloader.dataset, 'pipeline': []})
    store, classes = LabelStore(work_dir / 'labels'), len(dataset.classes)
    counts = {
        name: np.zeros((classes, classes + 1), dtype=np.int64) for name in ('nearest', 'regions', 'filled', 'spread')
    }
    for index, scene in enumerate(dataset.scene_ids):
        labels, xyz = store.read(scene, 0), dataset.load_cloud(index).xyz
        hidden = np.where(labels.point_is_annotated, UNLABELLED, dataset.load_truth(index).semantic)
        said = {
            'nearest': _nearest(xyz, np.where(labels.point_is_annotated, labels.semantic, UNLABELLED)),
            'regions': labels.semantic,
            'filled': _nearest(xyz, labels.semantic),
            'spread': _nearest(xyz, store.read(scene, store.rounds()[-1]).semantic),
        }
        for name, rows in said.items():
            counts[name] += confusion_counts(rows, hidden, classes)
    return {name: 100 * float(semantic_scores(count).mean_iou) for name, count in counts.items()}


def _nearest(xyz: np.ndarray, semantic: Int[np.ndarray, ' points']) -> Int[np.ndarray, ' points']:
    """Unlabelled points take the class of the nearest labelled one."""
    known, rest = np.flatnonzero(semantic >= 0), np.flatnonzero(semantic < 0)
    out = semantic.copy()
    if len(known):
        out[rest] = semantic[known[cKDTree(xyz[known]).query(xyz[rest])[1]]]
    return out


def propagation_table(
    out: Path,
    data: Sequence[str] = (),
    *,
    scenes: int = 100,
    points: int | None = None,
    seed: int = 0,
    data_root: Path | None = None,
    log: Callable[[str], None] = print,
    options: Mapping[str, Any] | None = None,
) -> str:
    """Table of :func:`propagate` over real scans, as markdown; also written to ``out/propagation.md`` line by line.

    Args:
        out: Folder of the runs; finished ones are kept.
        data: Not asked: what ``data_root`` holds is taken.
        scenes: Scans of each data set, at most.
        points: Not asked: scans are taken whole.
        seed: Of the labelled points and the training.
        data_root: Folder that holds ``oakland`` or ``semantickitti``; default: environment variable RM3D_REAL_DATA.
        log: Told what starts.
        options: Further config keys of every run.

    Raises:
        ConfigError: There are no real scans.
    """
    root = data_root or Path(os.environ.get('RM3D_REAL_DATA', 'data'))
    scans = oakland_scans(root / 'oakland')[:scenes]
    scans += semantickitti_scans(root / 'semantickitti', out / 'scans')[:scenes]
    if not scans:
        raise ConfigError(f'{root}: no oakland/*.xyz_label_conf, no semantickitti/sequences; name their folder')
    lines = [
        f'mIoU (%) on the unlabelled points of the same scan; at most 20 labelled points a class, seed {seed}',
        '',
        f'| scan | {" | ".join(COLUMNS.values())} |',
        f'|---|{"---|" * len(COLUMNS)}',
    ]
    rows: list[Spread] = []
    for scan in scans:
        rows.append(propagate(scan, out, {'seed': seed, **(options or {})}, log))
        lines.append(_line(scan.name, astuple(rows[-1])))
        mean = np.mean([astuple(row) for row in rows], axis=0).tolist()
        text = '\n'.join([*lines, _line('mean', mean)])
        write_text(out / 'propagation.md', text + '\n')
    return text


def _line(name: str, scores: Sequence[float]) -> str:
    return f'| {name} | {" | ".join(f"{score:.1f}" for score in scores)} |'
