"""Make the regions of every training scene beforehand, where regions merge (not by the random walk)."""

import argparse
from collections.abc import Sequence

from rm3d_plugin.commands.config_arguments import add_config_arguments, check_config, config_of
from rm3d_plugin.commands.numbers import whole


def main(arguments: Sequence[str] | None = None) -> None:
    """Read the arguments and prepare."""
    parser = argparse.ArgumentParser(prog='rm3d prepare', description=__doc__)
    add_config_arguments(parser)
    parser.add_argument('--jobs', type=whole(), default=1, help='processes; default 1')
    args = parser.parse_args(arguments)
    check_config(args)

    from rm3d_plugin.engine.run import prepare  # torch takes seconds; a wrong config is told before

    prepare(config_of(args), jobs=args.jobs)
