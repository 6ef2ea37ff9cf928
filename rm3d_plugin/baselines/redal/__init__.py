"""Region-based active learning: labels are asked for round by round."""

from typing import Any

from rm3d_plugin.baselines.method import method
from rm3d_plugin.baselines.redal.score import (
    CLUSTERS,
    DECAY,
    alike,
    asked_of_regions,
    class_entropy,
    decayed,
    surface_interest,
)
from rm3d_plugin.baselines.redal.source import RegionRoundsSource, RegionView

PARTS: dict[str, Any] = {
    'label_refreshes': None,
    'label_maker.source': {
        'type': 'RegionRoundsSource',
        'rounds': '${label_refreshes}',
        'geometry': '${region_geometry}',
    },
}
REDAL = method('redal', 'ReDAL', {'sem': PARTS, 'ins': PARTS}, declares=('budget grows', 'regions'))

__all__ = [
    'CLUSTERS',
    'DECAY',
    'REDAL',
    'RegionRoundsSource',
    'RegionView',
    'alike',
    'asked_of_regions',
    'class_entropy',
    'decayed',
    'surface_interest',
]
