"""Label propagation within one scan: a few labelled points of each class, scored on all others of the same scan."""

import os
import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from mmengine.registry import init_default_scope

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
SCHEDULE = {'sigma': 50, 'periods': [50, 100]}  # an epoch is one crop
METHODS: dict[str, dict[str, Any]] = {'weak': {'spread': False, 'label_rounds': 1}, 'rm3d': {}}


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
        regions: Regions of the labelled points, no network; what they do not reach is wrong.
        rm3d: Network trained by the whole method.
    """

    weak: float
    regions: float
    rm3d: float


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
    scans = []
    for labels in sorted(root.glob('sequences/*/labels/*.label')):
        sequence, number = labels.parent.parent, labels.stem
        alone = out / f'{sequence.name}_{number}'
        for part, ending in (('velodyne', '.bin'), ('labels', '.label')):
            target = alone / 'sequences' / f'{SEQUENCE:02d}' / part / f'{number}{ending}'
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(sequence / part / f'{number}{ending}', target)
        options = {'data_root': str(alone), 'train_sequences': [SEQUENCE], 'val_sequences': [SEQUENCE]}
        scans.append(Scan(f'SemanticKITTI {sequence.name}/{number}', 'rm3d_sem_semantickitti_few_1pct', options))
    return scans


def propagate(
    scan: Scan, out: Path, options: Mapping[str, Any] | None = None, log: Callable[[str], None] = print
) -> Spread:
    """Train the weak baseline and RM3D on one scan (finished runs are kept), and score all three ways.

    Args:
        scan: Which.
        out: Folder of the runs.
        options: Further config keys of both runs.
        log: Told what starts.
    """
    scores = {}
    for method, settings in METHODS.items():
        work_dir = out / f'{scan.name.replace(" ", "_").replace("/", "_").lower()}_{method}'
        if not read_record(work_dir)['final']:
            log(f'{work_dir}: training')
            train(_config(scan, work_dir, {**settings, **(options or {})}))
        scores[method] = float(read_record(work_dir)['final']['mIoU'])
    return Spread(scores['weak'], regions_alone(_config(scan, work_dir, options or {}), work_dir), scores['rm3d'])


def _config(scan: Scan, work_dir: Path, options: Mapping[str, Any]) -> Any:
    scored = [{'type': 'UnlabelledSemSegMetric', 'label_store': '${work_dir}/labels'}]
    keys: dict[str, Any] = {'budget': BUDGET, 'val_evaluator': scored} | SCHEDULE | dict(scan.options) | dict(options)
    init_default_scope(SCOPE)
    config = load_config(CONFIGS / f'{scan.config}.py', work_dir, options=keys)
    set_threads(int(config.threads))
    return config


def regions_alone(config: Any, work_dir: Path) -> float:
    """How good the first labels of a run are, mIoU in percent: made without a network, on points not revealed."""
    with config_errors(config):
        dataset = DATASETS.build({**config.val_dataloader.dataset, 'pipeline': []})
    store = LabelStore(work_dir / 'labels')
    counts = np.zeros((len(dataset.classes), len(dataset.classes) + 1), dtype=np.int64)
    for index, scene in enumerate(dataset.scene_ids):
        labels = store.read(scene, 0)
        hidden = np.where(labels.point_is_true, UNLABELLED, dataset.load_truth(index).semantic)
        counts += confusion_counts(labels.semantic, hidden, len(dataset.classes))
    return 100 * float(semantic_scores(counts).mean_iou)


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
        '| scan | labelled points alone | regions, no network | RM3D |',
        '|---|---|---|---|',
    ]
    for scan in scans:
        spread = propagate(scan, out, {'seed': seed, **(options or {})}, log)
        lines.append(f'| {scan.name} | {spread.weak:.1f} | {spread.regions:.1f} | {spread.rm3d:.1f} |')
        write_text(out / 'propagation.md', '\n'.join(lines) + '\n')
    return '\n'.join(lines)
