"""Predict scans: boxes from a detector's checkpoint, a class for each point from a segmentor's."""

import argparse
from collections.abc import Sequence
from pathlib import Path

from rm3d_plugin.commands.numbers import ANY, METRES, SHARE, whole
from rm3d_plugin.datasets.box_formats import BOX_FORMATS
from rm3d_plugin.inference.predict import predict_files
from rm3d_plugin.inference.predict_formats import FORMATS
from rm3d_plugin.inference.predict_points import PointOptions
from rm3d_plugin.storage.columns import ENDINGS

FEWEST = 1000  # points of a chunk: with fewer, a scan takes hours


def main(arguments: Sequence[str] | None = None) -> None:
    """Read the arguments and predict."""
    parser = _parser()
    args = parser.parse_args(arguments)
    if args.intensity_range is not None and not args.intensity_range[0] < args.intensity_range[1]:
        parser.error(f'argument --intensity-range: expected LOW below HIGH, got {args.intensity_range}')
    options = PointOptions(
        format=args.format,
        tta_rotations=args.tta_rotations,
        flip=args.flip,
        max_points=args.max_points,
        chunk_size=args.chunk,
        unknown_below=args.unknown_below,
        columns=args.columns,
        intensity_range=None if args.intensity_range is None else tuple(args.intensity_range),
        nan_points='drop' if args.drop_nan else 'error',
        labels=args.labels,
        fill=args.fill,
        paint=args.paint,
        classify=args.classify,
    )
    for path in predict_files(args.checkpoint, args.scans, args.out, args.min_score, args.device, options):
        print(path)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog='rm3d predict', description=__doc__)
    parser.add_argument('checkpoint', help='checkpoint of a training run; its config is inside')
    parser.add_argument('scans', nargs='+', type=Path, help=f'scans, or folders of them: {" ".join(ENDINGS)}')
    parser.add_argument('--out', type=Path, required=True, help='folder for what is written')
    parser.add_argument(
        '--min-score', type=SHARE, help='leave out boxes and instances that score lower; default 0.1 for boxes, else 0'
    )
    parser.add_argument('--device', default='cpu', help='cpu, cuda, cuda:1 ...; default cpu')
    parser.add_argument(
        '--format',
        choices=[*FORMATS, *BOX_FORMATS],
        default='ply',
        metavar='FORMAT',
        help=f'what is written: of points {", ".join(FORMATS)} (default ply), of boxes {", ".join(BOX_FORMATS)} '
        '(default json, and kitti where ../calib/NAME.txt is found)',
    )
    parser.add_argument('--columns', help='what the columns of a table hold: "x y z red green blue -"')
    parser.add_argument(
        '--drop-nan', action='store_true', help='leave out points whose place is NaN, as organised PCD has them'
    )
    parser.add_argument(
        '--intensity-range', type=ANY, nargs=2, metavar=('LOW', 'HIGH'), help='of the sensor: 0 65535, say'
    )
    points = parser.add_argument_group('classes of points')
    points.add_argument(
        '--tta-rotations', type=whole(), help='average over so many directions about z; default: as in the run'
    )
    points.add_argument('--flip', choices=['none', 'both'], help='both: each direction mirrored, too')
    points.add_argument('--chunk', type=METRES, metavar='METRES', help='predict in chunks of this edge')
    points.add_argument(
        '--max-points',
        type=whole(FEWEST),
        help=f'predict in chunks of at most so many points, {FEWEST} or more; default 1000000',
    )
    points.add_argument(
        '--unknown-below', type=SHARE, default=0.0, metavar='GAMMA', help='points less certain than this are unknown'
    )
    points.add_argument(
        '--paint', action='store_true', help="colours show the classes; default: the scan's own, where it has some"
    )
    points.add_argument(
        '--classify', action='store_true', help='LAS: classification holds the classes, and not the field label alone'
    )
    points.add_argument(
        '--labels',
        type=Path,
        metavar='WORK_DIR/labels',
        help="of the checkpoint's own run, for scans that it learnt from: points with a label there keep it",
    )
    points.add_argument(
        '--fill',
        choices=['network', 'nearest', 'likeliest'],
        help='with --labels: what names the other points; default: the class that the random walk finds likeliest, '
        'with merged regions the nearest label',
    )
    return parser
