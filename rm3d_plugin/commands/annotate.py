"""Label scans by clicks in a browser: labels spread at once, and the next click is suggested."""

import argparse
import time
import webbrowser
from collections.abc import Sequence
from pathlib import Path

from rm3d_plugin.annotation.demo_room import write_demo_room
from rm3d_plugin.annotation.session import Session
from rm3d_plugin.commands.numbers import number, whole
from rm3d_plugin.engine.config import ConfigError
from rm3d_plugin.engine.work_dir import check_folder
from rm3d_plugin.inference.predict import find_scans
from rm3d_plugin.storage.columns import ENDINGS

EXAMPLES = """examples:
  rm3d annotate street.laz --classes road building tree car
  rm3d annotate scans/ --log clicks.jsonl --out labelled/
  rm3d annotate --demo

Every click is on the disk when it is answered: start the command again to go on.
The page is on this machine alone; from another one: ssh -L 8080:127.0.0.1:8080 HOST"""
MINUTES = 20.0  # of a training that the button starts
DEMO = Path('data/annotate_demo')


def main(arguments: Sequence[str] | None = None) -> None:
    """Open a session and its page, until Ctrl-C."""
    args = _parser().parse_args(arguments)
    if args.demo == bool(args.scans):
        raise ConfigError('annotate: expected scans, or --demo; scans come before --classes')
    for name in args.classes:
        if ',' in name:
            raise ConfigError(f'annotate: --classes: got {name!r}; split names by blanks: road building')
    try:
        from rm3d_plugin.annotation.page import AnnotationPage, Outputs
    except ModuleNotFoundError as error:
        raise ConfigError(f'annotate: needs {error.name}: pip install "rm3d_plugin[annotate]"') from error
    scans = [write_demo_room(DEMO)] if args.demo else find_scans(args.scans, ENDINGS)
    out = args.out or scans[0].parent / 'labelled'
    check_folder(out)
    with Session(scans, args.log, args.classes, args.columns, args.drop_nan) as session:
        print(f'{_counted(scans)}; clicks: {session.log.path}; labels: {out}', flush=True)
        session.scan(session.scans[0])  # before the page, so that a scan that cannot be read is all that is said
        print('neighbours and features of the first scan ...', flush=True)
        outputs = Outputs(out, args.train or MINUTES, args.train is not None, tuple(args.cfg_options))
        page = AnnotationPage(session, outputs, args.port)
        print(f'{page.url}   (Ctrl-C ends; every click is kept)', flush=True)
        if not args.no_browser:
            webbrowser.open(page.url)
        try:
            while True:
                time.sleep(1.0)
        finally:
            page.stop()


def _counted(scans: Sequence[Path]) -> str:
    return f'{len(scans)} scans' if len(scans) > 1 else str(scans[0])


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog='rm3d annotate', description=__doc__, epilog=EXAMPLES, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument('scans', nargs='*', type=Path, help=f'scans, or folders of them: {" ".join(ENDINGS)}')
    parser.add_argument('--demo', action='store_true', help=f'a made-up room, written to {DEMO}')
    parser.add_argument(
        '--classes', nargs='+', default=[], metavar='NAME', help='there from the start; more on the page'
    )
    parser.add_argument(
        '--log', type=Path, metavar='FILE', help='.jsonl of the clicks; default SCAN.clicks.jsonl beside the scan'
    )
    parser.add_argument('--out', type=Path, metavar='FOLDER', help='for the labelled scans; default labelled/ beside')
    parser.add_argument('--columns', help='what the columns of a table hold: "x y z red green blue -"')
    parser.add_argument(
        '--drop-nan',
        action='store_true',
        help='leave points whose place is NaN without a label, as organised PCD has them',
    )
    parser.add_argument(
        '--train',
        type=number('minutes above 0', above=0.0),
        metavar='MINUTES',
        help='train a network for so long as soon as points of two classes are labelled; a button does it, too',
    )
    parser.add_argument(
        '--cfg-options', nargs='+', default=[], metavar='KEY=VALUE', help='config keys of trainings, see rm3d label'
    )
    parser.add_argument(
        '--port', type=whole(1, 65535), default=8080, help='of the page; the next free one; default 8080'
    )
    parser.add_argument('--no-browser', action='store_true', help='print where the page is, open none')
    return parser
