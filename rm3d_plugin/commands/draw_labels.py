"""Draw a label budget by seed: files that a run can use, the labels as clicks, a page with pictures."""

import argparse
from collections.abc import Sequence
from pathlib import Path

from rm3d_plugin.commands.config_arguments import config_of
from rm3d_plugin.commands.numbers import whole
from rm3d_plugin.engine.config import ConfigError
from rm3d_plugin.engine.key_values import KeyValues
from rm3d_plugin.reporting.draw_labels import draw_labels, source_of, source_of_dataset

EPILOG = """\
budgets of points:
  onept            one point of each class in every scene (the paper's 0.03 %)
  20pts            20 points of every scene (any number); 5pts_class: of each class in every scene
  0p2pct           0.2 % of the labelled points of every scene (any number), at least one of each class
  scenes5pct       5 % of the scenes, labelled completely (any number)
  onept_instance   one point of each instance
  full             everything
  NAME_no_instances  as NAME, but instance numbers stay hidden
  clicks=FILE, point_list=FILE, scene_list=FILE   what a person clicked, or others drew

budgets of boxes:
  1pct, 0p5pct, 3pct   two boxes per ten scenes, one per ten, 3 % of the boxes
  onebox           one object in each scene; onebox_scenes10pct, 2pct: in a tenth of the scenes
  scenes10pct      10 % of the scenes, labelled completely (any number)
  full             everything
  NAME_alike       as NAME, but classes take turns

examples:
  rm3d draw_labels configs/CONFIG.py --demo --out work_dirs/labels
  rm3d draw_labels --dataset ScanNetDataset --dataset-options data_root=data/scannet --budget 20pts --out labels
"""


def main(arguments: Sequence[str] | None = None) -> None:
    """Read the arguments and draw."""
    parser = argparse.ArgumentParser(
        prog='rm3d draw_labels',
        description=__doc__,
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument('config', nargs='?', help='config file of the run that shall have the labels')
    parser.add_argument(
        '--out', type=Path, required=True, help='folder; or one file .csv, .json, .jsonl (clicks) or .html'
    )
    parser.add_argument('--budget', help='what to show, see below; default: as the config says, else 0p2pct')
    parser.add_argument('--seed', type=whole(0), help='chooses the draw; default: as the config says, else 0')
    parser.add_argument('--scenes', type=whole(0), default=8, help='scenes that the page shows; default 8')
    parser.add_argument('--demo', action='store_true', help='on synthetic demo data, made on first use')
    parser.add_argument(
        '--cfg-options', nargs='+', action=KeyValues, default={}, metavar='KEY=VALUE', help='change config keys'
    )
    parser.add_argument('--dataset', help='instead of a config: type of a segmentation data set')
    parser.add_argument(
        '--dataset-options', nargs='+', action=KeyValues, default={}, metavar='KEY=VALUE', help='of --dataset'
    )
    parser.set_defaults(work_dir=None)
    args = parser.parse_args(arguments)
    if (args.config is None) == (args.dataset is None):
        raise ConfigError('draw_labels: give either a config or --dataset TYPE')
    if args.dataset is not None:
        title = f'Labels of {args.dataset}'
        source = source_of_dataset(args.dataset, args.dataset_options, args.budget or '0p2pct', args.seed or 0)
    else:
        title = f'Labels of {Path(args.config).stem}'
        source = source_of(config_of(args), args.budget, args.seed)
    written = draw_labels(source, args.out, title, args.scenes, args.demo)
    print(source.describe())
    print('\n'.join(f'written: {path}' for path in written))
