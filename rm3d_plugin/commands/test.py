"""Score a checkpoint on the validation scenes of a config."""

import argparse
from collections.abc import Sequence
from typing import TYPE_CHECKING

from rm3d_plugin.commands.config_arguments import add_config_arguments, check_config, config_of
from rm3d_plugin.commands.numbers import METRES, whole

if TYPE_CHECKING:
    from rm3d_plugin.engine.run import Evaluation


def main(arguments: Sequence[str] | None = None) -> None:
    """Read the arguments and evaluate."""
    parser = argparse.ArgumentParser(prog='rm3d test', description=__doc__)
    add_config_arguments(parser)
    parser.add_argument('checkpoint', help='checkpoint of a training run')
    points = parser.add_argument_group('segmentation; the same keys as model.inference of a config')
    points.add_argument('--tta-rotations', type=whole(), help='average over so many directions about z')
    points.add_argument('--flip', choices=['none', 'both'], help='both: each direction mirrored, too')
    points.add_argument('--chunk', dest='chunk_size', type=METRES, metavar='METRES', help='in chunks of this edge')
    points.add_argument('--max-points', type=whole(), help='in chunks of at most so many points')
    args = parser.parse_args(arguments)
    check_config(args)

    from rm3d_plugin.engine.run import evaluate  # torch takes seconds; a wrong config is told before

    config = config_of(args)
    wanted = {name: getattr(args, name) for name in ('tta_rotations', 'flip', 'chunk_size', 'max_points')}
    wanted = {name: value for name, value in wanted.items() if value is not None}
    if wanted:
        config.model.inference = {**(config.model.get('inference') or {}), **wanted}
    print(metric_table(evaluate(config, args.checkpoint)))


def metric_table(found: 'Evaluation') -> str:
    """Detection: a line for each class, metric and threshold; else a line for each number."""
    from rm3d_plugin.evaluation.kitti_table import format_table
    from rm3d_plugin.evaluation.point_fields import format_columns

    boxes = [record for record in found.records if record.table == 'boxes']
    if boxes:
        return format_table(boxes)
    return format_columns(('metric', '%'), [(name, f'{value:.2f}') for name, value in found.scores.items()])
