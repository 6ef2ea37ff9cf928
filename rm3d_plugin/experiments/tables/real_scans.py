"""Real scans, each learnt by itself: a data set of one scene, with the settings of own scans."""

import shutil
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from mmengine.config import Config

from rm3d_plugin.baselines import LABELLED_ONLY
from rm3d_plugin.engine.config import ConfigError
from rm3d_plugin.experiments.run_commands import config_path
from rm3d_plugin.experiments.scenes import real_root
from rm3d_plugin.experiments.spec import OURS, PAPER, Request, Row
from rm3d_plugin.storage import write_text

BUDGET = '20pts_class'  # at most so many points of a class
SEQUENCE = 0  # under which a single SemanticKITTI scan is laid out
OWN_SCANS = 'rm3d_sem_files_clicks'  # the leaf whose settings every scan gets
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


def real_scans(request: Request) -> list[Scan]:
    """Every real scan that is there.

    Args:
        request: Its ``data_root`` holds ``oakland`` or ``semantickitti`` (default: environment variable
            RM3D_REAL_DATA); ``scenes`` of each are taken, at most, whole; of the kinds in ``data`` alone, if any.

    Raises:
        ConfigError: There are none.
    """
    root = request.data_root or real_root()
    scans: list[Scan] = []
    if request.wants('oakland'):
        scans += oakland_scans(root / 'oakland')[: request.scenes]
    if request.wants('semantickitti'):
        scans += semantickitti_scans(root / 'semantickitti', request.out / 'scans')[: request.scenes]
    if not scans:
        raise ConfigError(f'{root}: no oakland/*.xyz_label_conf, no semantickitti/sequences; name their folder')
    return scans


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
    """``labelled_only``, ``paper`` and ``ours``: what is trained on one scan; writes the config into ``folder``."""
    leaf = str(write_leaf(scan, folder))
    return {
        'labelled_only': Row(f'{scan.name}: labelled points alone', leaf, LABELLED_ONLY.options['sem'], ()),
        'paper': Row(f'{scan.name}: {PAPER}', leaf, {'strategy': 'paper'}, ()),
        'ours': Row(f'{scan.name}: {OURS}', leaf, train=()),
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
        f'# {scan.name} with the settings of {OWN_SCANS}; written by a table of single scans.',
        f'_base_ = {str(config_path(scan.config).resolve())!r}',
        *(f'{name} = {value!r}' for name, value in plain.items()),
    ]
    return write_text(folder / f'{leaf_name(scan)}.py', '\n'.join(lines) + '\n')


def leaf_name(scan: Scan) -> str:
    """Name of the config of a scan.

    >>> leaf_name(Scan('SemanticKITTI 00/000000', 'rm3d_sem_semantickitti_few_1pct'))
    'semantickitti_00_000000'
    """
    return scan.name.replace(' ', '_').replace('/', '_').lower()


def _whole(value: Any) -> Any:
    """A dict takes the place of that of the leaf, instead of being merged into it."""
    return {'_delete_': True, **value} if isinstance(value, Mapping) else value
