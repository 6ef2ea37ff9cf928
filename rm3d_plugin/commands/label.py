"""Label every point of scans from a few clicks, at once; with time, a network learns along."""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from rm3d_plugin.commands.numbers import number, whole
from rm3d_plugin.engine.config import ConfigError
from rm3d_plugin.engine.key_values import KeyValues
from rm3d_plugin.inference.given_labels import clicked_labels, field_labels
from rm3d_plugin.inference.label_files import (
    SAME,
    SUMMARY,
    LabelledFiles,
    LabelOptions,
    Summary,
    WrittenScan,
    check_outputs,
    label_files,
)
from rm3d_plugin.inference.label_refresh import label_again
from rm3d_plugin.inference.label_training import TrainingOptions
from rm3d_plugin.inference.predict import find_scans
from rm3d_plugin.inference.predict_formats import FORMATS, check_format
from rm3d_plugin.inference.scan_kind import KINDS, Kind
from rm3d_plugin.storage.columns import ENDINGS
from rm3d_plugin.storage.written_files import real_path

STOPPED = 130  # exit code of a program that Ctrl-C ends
EXAMPLES = """examples:
  rm3d label street.ply --clicks clicks.csv --out labelled/
  rm3d label scans/ --labels classification --out labelled/
  rm3d label street.ply --clicks clicks.csv --out labelled/ --train 20 --more others/

clicks.csv, by place (metres, as in the scan) or by the number of the point:
  scene,x,y,z,class                   scene,index,class
  street,12.31,-4.02,0.11,ground      street,4711,ground

The labels without training are written first, always. --train replaces them where clicks
that the network was not taught are likelier with it; Ctrl-C leaves them as they are."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Read the arguments, label, and print what is to be known of each scan."""
    args = _parser().parse_args(arguments)
    if args.more and args.train is None:
        raise ConfigError('--more: a network predicts these scans; add --train MINUTES')
    options = LabelOptions(args.format, args.columns, not args.no_check, args.seed)
    clicks = [] if args.clicks is None else [args.clicks]
    scans = _other_than(clicks, find_scans(_other_than(clicks, args.scans), ENDINGS))
    more = _other_than([*clicks, *scans], find_scans(_other_than(clicks, args.more), ENDINGS)) if args.more else []
    check_outputs([*scans, *more], clicks, args.out, options)
    training = None if args.train is None else TrainingOptions(args.train, args.cfg_options, place=not more)
    given = (
        field_labels(args.labels, scans, args.columns, args.unlabelled)
        if args.clicks is None
        else clicked_labels(args.clicks, scans, args.columns)
    )
    if args.format != SAME:
        check_format(args.format, given.names)
    files, summary = LabelledFiles(scans, given, options), Summary(args.out, given)
    kinds: set[Kind] = set()
    for written in label_files(files, args.out, summary):
        kinds.add(args.kind or written.kind.kind)
        print(told(written, given.names, args.kind), flush=True)
    if training is not None:
        _train(files, kinds, more, args.out, training, summary)
    print(args.out / SUMMARY)


def _other_than(taken: Sequence[Path], found: Sequence[Path]) -> list[Path]:
    known = {real_path(path) for path in taken}
    return [scan for scan in found if real_path(scan) not in known]


def _train(
    files: LabelledFiles,
    kinds: set[Kind],
    more: Sequence[Path],
    out: Path,
    training: TrainingOptions,
    summary: Summary,
) -> None:
    """Train, and print what came of it; Ctrl-C ends with the first labels.

    Raises:
        ConfigError: The scans are of several kinds, or see :func:`label_again`.
    """
    if len(kinds) > 1:
        raise ConfigError(
            f'--train: the scans are of several kinds: {", ".join(sorted(kinds))}; label them apart, or give --kind; '
            'the first labels stand'
        )
    (kind,) = kinds
    print(f'training by rm3d_sem_files_{kind}_clicks for {training.minutes:g} min, into {out / "training"}', flush=True)
    try:
        for written in label_again(files, kind, more, out, training, summary):
            print(told_again(written), flush=True)
    except KeyboardInterrupt:
        print('stopped; the labels written so far stand', file=sys.stderr)
        sys.exit(STOPPED)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog='rm3d label', description=__doc__, epilog=EXAMPLES, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument('scans', nargs='+', type=Path, help=f'scans, or folders of them: {" ".join(ENDINGS)}')
    few = parser.add_mutually_exclusive_group(required=True)
    few.add_argument(
        '--clicks',
        type=Path,
        metavar='FILE',
        help='.csv, .json or .jsonl: scene,x,y,z,class or scene,index,class; scene = name of a scan without its ending',
    )
    few.add_argument(
        '--labels', metavar='FIELD', help='the clicks are in this field of the scans: -1 or NaN = unlabelled'
    )
    parser.add_argument(
        '--out', type=Path, required=True, metavar='FOLDER', help=f'for the labelled scans and {SUMMARY}'
    )
    parser.add_argument('--no-check', action='store_true', help='leave no clicks out: faster, no estimate')
    parser.add_argument('--seed', type=whole(0), default=0, help='of which clicks are left out together; default 0')
    _add_reading_and_writing(parser)
    _add_training(parser)
    return parser


def _add_reading_and_writing(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group('reading and writing')
    group.add_argument(
        '--format',
        choices=[SAME, *FORMATS],
        default=SAME,
        help='same: that of the input, with its fields (PLY for kinds that are only read); default same',
    )
    group.add_argument('--columns', help='what the columns of a table hold: "x y z red green blue -"')
    group.add_argument(
        '--unlabelled',
        nargs='+',
        type=int,
        default=[],
        metavar='N',
        help='further values of FIELD that mean unlabelled; 0 and 1 of the classification of LAS do always',
    )


def _add_training(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group('training')
    group.add_argument(
        '--train',
        type=number('minutes above 0', above=0.0),
        metavar='MINUTES',
        help='train a network for so long, after the labels',
    )
    group.add_argument(
        '--more', nargs='+', type=Path, default=[], metavar='SCAN', help='scans without clicks that it predicts'
    )
    group.add_argument('--kind', choices=KINDS, help='of the scans; default: told from how their points lie')
    group.add_argument(
        '--cfg-options',
        nargs='+',
        action=KeyValues,
        default={},
        metavar='KEY=VALUE',
        help='change keys of the config rm3d_sem_files_KIND_clicks: voxel_size=0.1 seed=1',
    )


def told(written: WrittenScan, names: Sequence[str], kind: Kind | None = None) -> str:
    """What is printed of a scan.

    Args:
        written: The scan.
        names: Of the classes.
        kind: Where it was given.
    """
    found = written.labelled
    counts = ', '.join(f'{name} {count}' for name, count in zip(names, found.clicks.tolist(), strict=True) if count)
    clicks = f'{found.clicks.sum()} clicks ({counts})' if counts else 'no clicks'
    lines = [
        f'{written.scan.name}: {clicks} on {len(found.semantic)} points, {found.seconds:.1f} s',
        f'  {written.kind.text() if kind is None else f"{kind}: as given"}',
        f'  {found.remark()}',
        *(f'  {path}' for path in written.files),
    ]
    return '\n'.join(lines)


def told_again(written: WrittenScan) -> str:
    """What is printed of a scan after the training: whether the network was heard, and what was written."""
    found, name = written.labelled, written.scan.name
    if not written.files:
        return f'{name}: clicks that the network was not taught do not speak for it: the first labels stand'
    if not found.network_weight:
        return '\n'.join([f'{name}: predicted by the network', *(f'  {path}' for path in written.files)])
    lines = [f'{name}: clicks that the network was not taught speak for it, labelled again', f'  {found.remark()}']
    return '\n'.join([*lines, *(f'  {path}' for path in written.files)])
