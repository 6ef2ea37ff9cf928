"""Make a table of the documentation anew: train its runs (finished ones are kept), then print it."""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from rm3d_plugin.engine.reproduce import TABLES, reproduce
from rm3d_plugin.engine.run import exit_code


def main(arguments: Sequence[str] | None = None) -> None:
    """Read the arguments and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('table', choices=sorted(TABLES), help='; '.join(f'{k}: {t.title}' for k, t in TABLES.items()))
    parser.add_argument('--seeds', type=int, nargs='+', default=[0, 1, 2], help='one run a seed; default 0 1 2')
    parser.add_argument('--out', type=Path, help='folder of the runs; default work_dirs/reproduce/TABLE')
    parser.add_argument('--jobs', type=int, default=1, help='runs at the same time, one thread each; default 1')
    parser.add_argument('--cfg-options', nargs='+', default=[], metavar='KEY=VALUE', help='config keys of every run')
    args = parser.parse_args(arguments)
    out = args.out or Path('work_dirs/reproduce') / args.table
    print(reproduce(args.table, args.seeds, out, args.jobs, args.cfg_options))


if __name__ == '__main__':
    sys.exit(exit_code(main))
