"""Label every point of scans from a few clicks in each, without training."""

import argparse
from collections.abc import Sequence
from pathlib import Path

from rm3d_plugin.inference.given_labels import clicked_labels, field_labels
from rm3d_plugin.inference.label_files import SAME, SUMMARY, LabelOptions, WrittenScan, check_outputs, label_files
from rm3d_plugin.inference.predict import find_scans
from rm3d_plugin.inference.predict_formats import FORMATS, check_format
from rm3d_plugin.storage.columns import ENDINGS


def main(arguments: Sequence[str] | None = None) -> None:
    """Read the arguments, label, and print what is to be known of each scan."""
    args = _parser().parse_args(arguments)
    options = LabelOptions(args.format, args.columns, not args.no_check, args.seed)
    clicks = [] if args.clicks is None else [args.clicks]
    scans = [
        scan for scan in find_scans(args.scans, ENDINGS) if scan.resolve() not in [path.resolve() for path in clicks]
    ]
    check_outputs(scans, clicks, args.out, options)
    given = (
        field_labels(args.labels, scans, args.columns, args.unlabelled)
        if args.clicks is None
        else clicked_labels(args.clicks, scans, args.columns)
    )
    if args.format != SAME:
        check_format(args.format, given.names)
    for written in label_files(scans, given, args.out, options):
        print(told(written, given.names), flush=True)
    print(args.out / SUMMARY)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog='rm3d label',
        description=__doc__,
        epilog='Example: rm3d label street.ply --clicks clicks.csv --out labelled/',
    )
    parser.add_argument('scans', nargs='+', type=Path, help=f'scans, or folders of them: {" ".join(ENDINGS)}')
    few = parser.add_mutually_exclusive_group(required=True)
    few.add_argument(
        '--clicks',
        type=Path,
        help='.csv, .json or .jsonl: scene,x,y,z,class or scene,index,class; scene = name of a scan',
    )
    few.add_argument(
        '--labels', metavar='FIELD', help='the clicks are in this field of the scans: -1 or NaN = unlabelled'
    )
    parser.add_argument('--out', type=Path, required=True, help=f'folder for the labelled scans and {SUMMARY}')
    parser.add_argument(
        '--format',
        choices=[SAME, *FORMATS],
        default=SAME,
        help='same: that of the input, with its fields (PLY for kinds that are only read); default same',
    )
    parser.add_argument(
        '--unlabelled',
        nargs='+',
        type=int,
        default=[],
        metavar='N',
        help='further values of FIELD that mean unlabelled; 0 and 1 of the classification of LAS do always',
    )
    parser.add_argument('--columns', help='what the columns of a table hold: "x y z red green blue -"')
    parser.add_argument('--seed', type=int, default=0, help='of which clicks are left out together; default 0')
    parser.add_argument('--no-check', action='store_true', help='leave no clicks out: faster, no estimate')
    return parser


def told(written: WrittenScan, names: Sequence[str]) -> str:
    """What is printed of a scan.

    Args:
        written: The scan.
        names: Of the classes.
    """
    found = written.labelled
    counts = ', '.join(f'{name} {count}' for name, count in zip(names, found.clicks.tolist(), strict=True) if count)
    lines = [
        f'{written.scan.name}: {found.clicks.sum()} clicks ({counts}) on {len(found.semantic)} points, '
        f'{found.seconds:.1f} s',
        f'  {written.kind.text()}',
        f'  {found.remark()}',
        *(f'  {path}' for path in written.files),
    ]
    return '\n'.join(lines)
