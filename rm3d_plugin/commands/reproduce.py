"""Make a table of the documentation again: train or measure what is missing, then print it."""

import argparse
from collections.abc import Sequence
from pathlib import Path

from rm3d_plugin.commands.numbers import whole
from rm3d_plugin.engine.config import ConfigError
from rm3d_plugin.experiments import FORMATS, TABLES, Request, list_tables, make_all, make_table, to_format
from rm3d_plugin.experiments.scenes import COLLECTIONS


def main(arguments: Sequence[str] | None = None) -> None:
    """Read the arguments and print the table."""
    args = _parser().parse_args(arguments)
    request = Request(
        out=args.out or Path('work_dirs/reproduce') / (args.table or ''),
        seeds=tuple(args.seeds),
        jobs=args.jobs,
        options=tuple(args.cfg_options),
        data=tuple(args.data),
        descriptors=tuple(args.descriptors),
        scenes=args.scenes,
        points=args.points or None,
        seed=args.seed,
        data_root=args.data_root,
    )
    if args.list:
        print(list_tables(request))
    elif args.table is None:
        raise ConfigError('reproduce: name a table; --list shows them')
    elif args.table == 'all':
        print(make_all(request, minutes=args.budget_minutes), end='')
    else:
        table = make_table(args.table, request, minutes=args.budget_minutes)
        if args.format == 'png':
            print(request.out / f'{args.table}.png')
        else:
            print(to_format(table, args.format).decode(), end='')


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog='rm3d reproduce', description=__doc__)
    parser.add_argument(
        'table', nargs='?', choices=[*sorted(TABLES), 'all'], help='its name, or all; --list tells what each shows'
    )
    parser.add_argument('--list', action='store_true', help='list the tables, and how many runs each trains')
    parser.add_argument('--out', type=Path, help='folder of the results; default work_dirs/reproduce/TABLE')
    parser.add_argument('--format', choices=FORMATS, default='md', help='what to print; all are written; default md')
    training = parser.add_argument_group('tables that train')
    training.add_argument('--seeds', type=whole(0), nargs='+', default=[0, 1, 2], help='one run a seed; default 0 1 2')
    training.add_argument('--jobs', type=whole(), default=1, help='runs at the same time, one thread each; default 1')
    training.add_argument('--cfg-options', nargs='+', default=[], metavar='KEY=VALUE', help='config keys of every run')
    training.add_argument(
        '--budget-minutes',
        type=whole(),
        help='make demos smaller (scenes, epochs, parts, seeds, then rows), to end in about so many minutes',
    )
    measured = parser.add_argument_group('tables that measure scenes')
    measured.add_argument('--scenes', type=whole(), default=2, help='scenes of each kind; default 2')
    measured.add_argument(
        '--points', type=whole(0), default=20000, help='of each scene, nearest to its middle; 0: all; default 20000'
    )
    measured.add_argument('--seed', type=whole(0), default=0, help='of labels, turns and noise; default 0')
    measured.add_argument(
        '--data',
        nargs='+',
        default=list(COLLECTIONS),
        choices=COLLECTIONS,
        help='kinds of scenes; default: all there are',
    )
    measured.add_argument(
        '--descriptors', nargs='+', default=[], metavar='NAME', help='rows of tables of descriptors; default: all'
    )
    measured.add_argument('--data-root', type=Path, help='folder of the scenes; default OUT/data, RM3D_REAL_DATA')
    return parser
