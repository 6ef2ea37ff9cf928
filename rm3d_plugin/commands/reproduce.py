"""Make a table of the documentation again: train or measure what is missing, then print it."""

import argparse
from collections.abc import Sequence
from pathlib import Path

from rm3d_plugin.experiments.reproduce import MEASURED, TABLES, measure, reproduce
from rm3d_plugin.experiments.table_scenes import COLLECTIONS


def main(arguments: Sequence[str] | None = None) -> None:
    """Read the arguments and print the table."""
    parser = argparse.ArgumentParser(prog='rm3d reproduce', description=__doc__)
    titles = {key: table.title for key, table in TABLES.items()} | {key: table.title for key, table in MEASURED.items()}
    parser.add_argument('table', choices=sorted(titles), help='; '.join(f'{k}: {t}' for k, t in titles.items()))
    parser.add_argument('--out', type=Path, help='folder of the results; default work_dirs/reproduce/TABLE')
    training = parser.add_argument_group('tables that train')
    training.add_argument('--seeds', type=int, nargs='+', default=[0, 1, 2], help='one run a seed; default 0 1 2')
    training.add_argument('--jobs', type=int, default=1, help='runs at the same time, one thread each; default 1')
    training.add_argument('--cfg-options', nargs='+', default=[], metavar='KEY=VALUE', help='config keys of every run')
    measured = parser.add_argument_group('tables that measure scenes', f'({", ".join(MEASURED)})')
    measured.add_argument('--scenes', type=int, default=2, help='scenes of each kind; default 2')
    measured.add_argument(
        '--points', type=int, default=20000, help='of each scene, nearest to its middle; 0: all; default 20000'
    )
    measured.add_argument('--seed', type=int, default=0, help='of labels, turns and noise; default 0')
    measured.add_argument(
        '--data',
        nargs='+',
        default=list(COLLECTIONS),
        choices=COLLECTIONS,
        help='kinds of scenes; default: all there are',
    )
    measured.add_argument('--data-root', type=Path, help='folder of the synthetic scenes; default OUT/data')
    args = parser.parse_args(arguments)
    out = args.out or Path('work_dirs/reproduce') / args.table
    if args.table in MEASURED:
        print(measure(args.table, out, args.data, args.scenes, args.points or None, args.seed, args.data_root))
    else:
        print(reproduce(args.table, args.seeds, out, args.jobs, args.cfg_options))
