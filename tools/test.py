"""Score a checkpoint on the validation scenes of a config."""

import argparse
import sys
from collections.abc import Sequence

from rm3d_plugin.engine.run import add_config_arguments, config_of, evaluate, exit_code
from rm3d_plugin.evaluation.kitti_metric import format_table


def main(arguments: Sequence[str] | None = None) -> None:
    """Read the arguments and evaluate."""
    parser = argparse.ArgumentParser(description=__doc__)
    add_config_arguments(parser)
    parser.add_argument('checkpoint', help='checkpoint of a training run')
    args = parser.parse_args(arguments)
    print(format_table(evaluate(config_of(args), args.checkpoint)))


if __name__ == '__main__':
    sys.exit(exit_code(main))
