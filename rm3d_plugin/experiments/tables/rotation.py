"""Trained as scanned, tested turned: by descriptor, and by what the network is given against turning."""

from collections.abc import Mapping
from typing import Any

from rm3d_plugin.experiments.spec import PaperTable, Part, Row
from rm3d_plugin.experiments.tables.paper_rows import (
    AS_PAPER,
    DEFAULT,
    PAPER,
    descriptor_rows,
    leaf_row,
    once,
    trivial_rows,
)

LEAF = 'rm3d_ins_scannet_0p2pct'
ANGLES = (0, 45, 90, 135, 180)  # degrees about z, from where the training scenes stand
AS_SCANNED: Mapping[str, Any] = {'train_pipeline.1.rot': [0.0, 0.0], 'first_angle': 0.0}  # training sees no turned room
NETWORKS: dict[str, Mapping[str, Any]] = {
    'training turns rooms': {},
    'tested from four directions': {**AS_SCANNED, 'tta_rotations': 4},
    'the network knows the place in the room': {**AS_SCANNED, 'use_coordinates': True},
}


def _rows(angle: int) -> tuple[Row, ...]:
    turned = {'first_angle': float(angle)}
    base = leaf_row(PAPER, LEAF, {**AS_PAPER, **AS_SCANNED}, 'AdaptedPFH', turned)
    described = (row for row in descriptor_rows(LEAF, {**AS_PAPER, **AS_SCANNED}, turned) if row.name != 'AdaptedPFH')
    networks = (leaf_row(name, LEAF, {**AS_PAPER, **options}, test=turned) for name, options in NETWORKS.items())
    alone, default = trivial_rows('ins', 'scannet', '0p2pct')
    others = (
        leaf_row(alone.name, alone.config, AS_SCANNED, test=turned),
        leaf_row(DEFAULT, default.config, AS_SCANNED, test=turned),
    )
    return once((base, *described, *networks, *others))


def _part(angle: int) -> Part:
    column = 'scannet_0p2pct' if angle == 0 else 'scannet_0p2pct_turned'
    return Part(f'Turned by {angle} degrees, AP50', _rows(angle), ('AP50',), PAPER, f'table_inseg:{column}')


ROTATION = PaperTable(
    'Instances of rooms, trained as scanned and tested turned about z, in percent',
    tuple(_part(angle) for angle in (0, 90, *(other for other in ANGLES if other not in (0, 90)))),
    (
        'The paper turns by a random angle of 0 to 180 degrees; its second value stands beside every angle but 0.',
        'Descriptors make labels of training scenes alone; descriptors-overseg tells what turning does to regions.',
    ),
)
