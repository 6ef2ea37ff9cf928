"""Find objects in scans without labels: KITTI-like .bin files in, boxes out."""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from rm3d_plugin.engine.predict import predict_files
from rm3d_plugin.engine.run import exit_code


def main(arguments: Sequence[str] | None = None) -> None:
    """Read the arguments and predict."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('checkpoint', help='checkpoint of a training run; its config is inside')
    parser.add_argument('scans', nargs='+', type=Path, help='.bin files, or folders of them')
    parser.add_argument(
        '--out', type=Path, required=True, help='folder for NAME.json, and NAME.txt where ../calib has NAME'
    )
    parser.add_argument('--min-score', type=float, default=0.1, help='leave out boxes that score lower; default 0.1')
    parser.add_argument('--device', default='cpu', help='cpu, cuda, cuda:1 ...; default cpu')
    args = parser.parse_args(arguments)
    scans = [scan for path in args.scans for scan in (sorted(path.glob('*.bin')) if path.is_dir() else [path])]
    if not scans:
        parser.error(f'no .bin file in {", ".join(map(str, args.scans))}')
    for path in predict_files(args.checkpoint, scans, args.out, args.min_score, args.device):
        print(path)


if __name__ == '__main__':
    sys.exit(exit_code(main))
