"""Divide a scan into regions: coloured points (.ply), labels (.npz) or a 3D page (.html)."""

import argparse
from collections.abc import Sequence
from pathlib import Path

from rm3d_plugin.commands.numbers import whole
from rm3d_plugin.engine.key_values import KeyValues
from rm3d_plugin.inference.oversegment import PRESETS, discarded_text, oversegment_file


def main(arguments: Sequence[str] | None = None) -> None:
    """Read the arguments and divide."""
    parser = argparse.ArgumentParser(
        prog='rm3d oversegment',
        description=__doc__,
        epilog='Example: rm3d oversegment room.ply --descriptor FPFH --oversegmenter VCCS '
        '--oversegmenter-options seed_size=0.5 --out regions.html',
    )
    parser.add_argument('scan', type=Path, help='points in metres, z up')
    parser.add_argument('--out', type=Path, required=True, help='.ply (coloured), .npz (labels) or .html (3D view)')
    parser.add_argument('--descriptor', help="type name, FPFH say; default: the preset's, or AdaptedPFH")
    parser.add_argument(
        '--oversegmenter', help="RegionGrowing, VCCS or CutPursuit; default: the preset's, or RegionGrowing"
    )
    parser.add_argument(
        '--preset',
        choices=PRESETS,
        help='numbers that suit a kind of scene; outdoor and airborne: the parts that training on such scans uses',
    )
    parser.add_argument(
        '--columns',
        help="names of a table's columns, - for one to pass over: 'x y z red green blue -'; default: by their number, "
        "3 'x y z', 4 with intensity, 6 with red green blue, 7 with intensity red green blue",
    )
    parser.add_argument(
        '--tune',
        type=Path,
        metavar='LABELS',
        help='CSV (scene,x,y,z,class or scene,index,class) or JSON with some labelled points of the scan: theta and '
        'zeta of RegionGrowing are chosen by them',
    )
    parser.add_argument(
        '--target-regions', type=whole(), help='regions that --tune aims at; default: one for 150 points'
    )
    for part in ('descriptor', 'oversegmenter'):
        parser.add_argument(
            f'--{part}-options', nargs='+', action=KeyValues, default={}, metavar='KEY=VALUE', help=f'of the {part}'
        )
    args = parser.parse_args(arguments)
    regions = oversegment_file(
        args.scan,
        args.out,
        args.descriptor,
        args.oversegmenter,
        args.preset,
        args.descriptor_options,
        args.oversegmenter_options,
        args.columns,
        args.tune,
        args.target_regions,
    )
    print(f'{args.out}: {len(regions)} regions; {discarded_text(regions)}')
