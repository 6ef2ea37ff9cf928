"""Show the merges of a run: the strongest and weakest, and what other thresholds would have merged."""

import argparse
from collections.abc import Sequence
from pathlib import Path

from rm3d_plugin.commands.numbers import whole
from rm3d_plugin.engine.config import ConfigError
from rm3d_plugin.engine.key_values import KeyValues
from rm3d_plugin.reporting.replay import RoundOfLabels, format_extremes, format_replay, source_of_run


def main(arguments: Sequence[str] | None = None) -> None:
    """Read the arguments and print."""
    parser = argparse.ArgumentParser(
        prog='rm3d inspect_merges',
        description=__doc__,
        epilog='Example: rm3d inspect_merges --labels work_dirs/x/labels --round 3 --replay tau=.7 gamma=.8',
    )
    parser.add_argument('--labels', type=Path, required=True, help='label store of a run: WORK_DIR/labels')
    parser.add_argument('--round', type=whole(0), help='which round; default: the one that training reads')
    parser.add_argument('--scene', help='one scene; default: all')
    parser.add_argument(
        '--replay',
        nargs='+',
        action=KeyValues,
        metavar='KEY=VALUE',
        help='decide the merges of the round again without training: tau (what the compared mean must reach) and any '
        'field of MergeRules or cbst_fraction, gamma=.8 thresholds=literal cbst_fraction=.2 say',
    )
    parser.add_argument(
        '--ledger',
        nargs='?',
        const=10,
        type=whole(),
        metavar='COUNT',
        help='list strongest and weakest merges; default 10',
    )
    parser.add_argument('--config', type=Path, help='config of the run, for the truth; default: the one beside labels')
    args = parser.parse_args(arguments)
    if args.replay is None and args.ledger is None:
        raise ConfigError('rm3d inspect_merges: nothing to do; give --replay KEY=VALUE or --ledger')
    source = None
    if args.replay is not None:
        source, why = source_of_run(args.labels, args.config)
        if source is None:
            print(f'precision is not shown: {why}')
    chosen = RoundOfLabels(args.labels, args.round, args.scene, source)
    if args.ledger is not None:
        print(format_extremes(chosen, args.ledger))
    if args.replay is not None:
        print(format_replay(chosen.replay(args.replay), args.replay))
