"""Tables of the documentation: train or measure what they need, then print them."""

import statistics
import subprocess
import sys
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from rm3d_plugin.datasets.oakland_format import CLASSES as OAKLAND_CLASSES
from rm3d_plugin.engine.config import ConfigError
from rm3d_plugin.engine.hooks.run_record_hook import read_record
from rm3d_plugin.experiments.overseg_table import descriptor_table
from rm3d_plugin.experiments.propagation import propagation_table
from rm3d_plugin.experiments.robustness import robustness_card
from rm3d_plugin.experiments.table_scenes import COLLECTIONS
from rm3d_plugin.storage import LabelStore, write_text


@dataclass(frozen=True)
class Table:
    """Which runs a table compares, and by which scores.

    Attributes:
        title: One line.
        configs: Name of the row -> config leaf in ``configs/``; the last row is the reference of the ratios.
        scores: Heading -> key of ``metrics.json``.
        demo: Run on the embedded synthetic data.
        labels: Tell how many points have a label in the last round, and how many of the pseudo labels are right.
        ratio: Tell the ratio to the last row.
    """

    title: str
    configs: dict[str, str]
    scores: dict[str, str]
    demo: bool = True
    labels: bool = False
    ratio: bool = True


def _rows(kind: str, *budgets: str, data: str = 'scannet') -> dict[str, str]:
    """Weak baseline and RM3D for each budget, then full supervision."""
    return _pairs(kind, *budgets, data=data) | {'all points': f'sup_{kind}_{data}_full'}


def _pairs(kind: str, *budgets: str, data: str) -> dict[str, str]:
    """Weak baseline and RM3D for each budget."""
    rows = {}
    for budget in budgets:
        rows[f'labelled points alone ({_NAMED[budget]})'] = f'sup_{kind}_{data}_{budget}'
        rows[f'RM3D ({_NAMED[budget]})'] = f'rm3d_{kind}_{data}_{budget}'
    return rows


_NAMED = {
    '0p1pct': '0.1 % of the points',
    '0p2pct': '0.2 % of the points',
    'onept': 'a point a class',
    '20pts': '20 points',
    '1pct': '1 %',
    '20pct': '20 %',
}


TABLES = {
    'kitti-demo': Table(
        title='3D AP (moderate, R40) on synthetic streets; IoU .5 for cars, .25 for pedestrians and cyclists',
        configs={
            'labelled boxes alone (1 %)': 'sup_votenet_kitti_1pct',
            'RM3D (1 %)': 'rm3d_votenet_kitti_1pct',
            'all boxes': 'sup_votenet_kitti_full',
        },
        scores={
            'Car': 'Car_3d_moderate_R40@0.50',
            'Pedestrian': 'Pedestrian_3d_moderate_R40@0.25',
            'Cyclist': 'Cyclist_3d_moderate_R40@0.25',
            'mean': 'mAP_3d_moderate_R40_loose',
        },
    ),
    'rooms-demo': Table(
        title='mIoU on synthetic rooms, in percent',
        configs=_rows('sem', '0p2pct', 'onept'),
        scores={'mIoU': 'mIoU'},
        labels=True,
    ),
    'rooms-demo-budgets': Table(
        title='mIoU on synthetic rooms, in percent; other budgets',
        configs=_rows('sem', '20pts', '1pct'),
        scores={'mIoU': 'mIoU'},
        labels=True,
    ),
    'streets-demo': Table(
        title='mIoU on synthetic streets, in percent',
        configs=_rows('sem', '0p2pct', 'onept', data='semantickitti'),
        scores={'mIoU': 'mIoU'},
        labels=True,
    ),
    'streets-demo-budgets': Table(
        title='mIoU on synthetic streets, in percent; other budgets',
        configs=_rows('sem', '20pts', '1pct', data='semantickitti'),
        scores={'mIoU': 'mIoU'},
        labels=True,
    ),
    'oakland': Table(
        title='IoU on the test tiles of Oakland, in percent (real data: --cfg-options data_root=FOLDER)',
        configs=_pairs('sem', '0p1pct', '1pct', '20pct', data='oakland'),
        scores={name: f'IoU_{name}' for name in OAKLAND_CLASSES} | {'mIoU': 'mIoU'},
        demo=False,
        labels=True,
        ratio=False,
    ),
    'rooms-demo-instances': Table(
        title='AP of instances on synthetic rooms, in percent',
        configs=_rows('ins', '0p2pct', 'onept'),
        scores={'mIoU': 'mIoU', 'AP': 'AP', 'AP25': 'AP25', 'AP50': 'AP50'},
        labels=True,
    ),
}


class Measure(Protocol):
    """What measures a table without training, see :func:`rm3d_plugin.experiments.overseg_table.descriptor_table`."""

    def __call__(
        self,
        out: Path,
        data: Sequence[str],
        *,
        scenes: int,
        points: int | None,
        seed: int,
        data_root: Path | None,
        log: Callable[[str], None],
    ) -> str:
        """Write the table's files into ``out``; return it as markdown."""


@dataclass(frozen=True)
class Measured:
    """A table of measurements on scenes, without training.

    Attributes:
        title: One line.
        measure: What makes it.
    """

    title: str
    measure: Measure


MEASURED = {
    'descriptors-overseg': Measured(
        'Boundary scores of regions by descriptor, as scanned and turned', descriptor_table
    ),
    'propagation': Measured(
        'mIoU on the unlabelled points of single real scans, three ways (trains)', propagation_table
    ),
    'robustness-card': Measured('Similarity of the same point after turning, thinning and noise', robustness_card),
}


def measure(
    name: str,
    out: Path,
    data: Sequence[str] = tuple(COLLECTIONS),
    scenes: int = 2,
    points: int | None = None,
    seed: int = 0,
    data_root: Path | None = None,
    log: Callable[[str], None] = print,
) -> str:
    """Measure a table anew, and return it as markdown.

    Args:
        name: Key of :data:`MEASURED`.
        out: Folder of the table's files.
        data: Keys of :data:`rm3d_plugin.experiments.table_scenes.COLLECTIONS`; real data that are not there are left
            out.
        scenes: Scenes of each, at most.
        points: Of each scene, the so many points nearest to its middle; None: all.
        seed: Of all that is drawn.
        data_root: Folder where synthetic data are made or found; default ``out/data``.
        log: Told what is done.

    Raises:
        ConfigError: There is no such table or collection, or a file cannot be used.
    """
    if name not in MEASURED:
        raise ConfigError(f'no measured table {name!r}; there are: {", ".join(MEASURED)}')
    return MEASURED[name].measure(out, data, scenes=scenes, points=points, seed=seed, data_root=data_root, log=log)


def reproduce(
    name: str,
    seeds: Sequence[int],
    out: Path,
    jobs: int = 1,
    options: Sequence[str] = (),
    log: Callable[[str], None] = print,
) -> str:
    """Train every run of a table that is not finished in ``out``, and return the table as markdown.

    Args:
        name: Key of :data:`TABLES`.
        seeds: One run a seed; the seed also draws the label budget.
        out: Folder of the runs and of the table.
        jobs: Runs at the same time, one thread each; with 1 a run takes every core.
        options: Further ``--cfg-options``.
        log: Told what starts and ends.

    Raises:
        ConfigError: There is no such table, or a run failed; its log is named.
    """
    if name not in TABLES:
        raise ConfigError(f'no table {name!r}; there are: {", ".join(TABLES)}')
    table = TABLES[name]
    runs = [(config, seed) for config in table.configs.values() for seed in seeds]
    with ThreadPoolExecutor(jobs) as pool:
        list(pool.map(lambda run: _train(run[0], run[1], table.demo, out, jobs, options, log), runs))
    text = render(table, seeds, out)
    write_text(out / f'{name}.md', text + '\n')
    return text


def _train(
    config: str, seed: int, demo: bool, out: Path, jobs: int, options: Sequence[str], log: Callable[[str], None]
) -> None:
    work_dir = run_dir(out, config, seed)
    if read_record(work_dir)['final']:
        log(f'{work_dir}: finished before')
        return
    log(f'{work_dir}: training')
    work_dir.mkdir(parents=True, exist_ok=True)
    root = Path(__file__).resolve().parents[2]
    command = [sys.executable, str(root / 'tools' / 'train.py'), str(root / 'configs' / f'{config}.py')]
    command += ['--demo'] * demo + ['--resume', '--work-dir', str(work_dir), '--cfg-options', f'seed={seed}']
    command += [f'threads={0 if jobs == 1 else 1}', *options]
    with (work_dir / 'train.log').open('w', encoding='utf-8') as stream:
        code = subprocess.run(command, stdout=stream, stderr=subprocess.STDOUT, check=False).returncode
    if code:
        raise ConfigError(f'{work_dir}: training ended with exit code {code}; see {work_dir / "train.log"}')
    log(f'{work_dir}: done')


def run_dir(out: Path, config: str, seed: int) -> Path:
    """Work directory of one run."""
    return out / f'{config}_seed{seed}'


def render(table: Table, seeds: Sequence[int], out: Path) -> str:
    """Mean and spread (lowest to highest) over the seeds, and the ratio of the means to the last row, as markdown."""
    values = {
        row: {
            head: [read_record(run_dir(out, config, seed))['final'][key] for seed in seeds]
            for head, key in table.scores.items()
        }
        for row, config in table.configs.items()
    }
    reference = list(values.values())[-1]
    last = list(table.scores)[-1]
    heads = [*table.scores, *([f'{last} / full'] if table.ratio else ()), *(LABEL_HEADS if table.labels else ())]
    lines = [
        f'{table.title}; mean of seeds {", ".join(map(str, seeds))} (lowest to highest)',
        '',
        f'| trained on | {" | ".join(heads)} |',
        f'|---|{"---|" * len(heads)}',
    ]
    for row, scores in values.items():
        cells = [_spread(v) for v in scores.values()]
        if table.ratio:
            full = statistics.mean(reference[last])
            cells.append(f'{100 * statistics.mean(scores[last]) / full:.0f} %' if full else '-')
        if table.labels:
            cells += [_spread(v) for v in _label_shares([run_dir(out, table.configs[row], seed) for seed in seeds])]
        lines.append(f'| {row} | {" | ".join(cells)} |')
    return '\n'.join(lines)


LABEL_HEADS = ('points with a label', 'pseudo labels right')


def _label_shares(runs: Sequence[Path]) -> tuple[list[float], list[float]]:
    """Coverage and precision of the last round's labels, in percent; no precision where nothing was pseudo."""
    stores = [LabelStore(run / 'labels') for run in runs]
    last = [store.summary(store.rounds()[-1]) for store in stores]
    right = [100 * summary['precision'] for summary in last if summary['precision'] is not None]
    return [100 * summary['coverage'] for summary in last], right


def _spread(values: Sequence[float]) -> str:
    """Mean, lowest and highest; a dash for none."""
    return f'{statistics.mean(values):.1f} ({min(values):.1f} to {max(values):.1f})' if values else '-'
