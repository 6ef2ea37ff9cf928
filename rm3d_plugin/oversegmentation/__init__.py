"""From points to regions: each over-segmenter partitions a cloud by its descriptors."""

from rm3d_plugin.oversegmentation.base import Oversegmenter
from rm3d_plugin.oversegmentation.cut_pursuit import CutPursuit
from rm3d_plugin.oversegmentation.ground_patches import GroundPatches
from rm3d_plugin.oversegmentation.precomputed import Precomputed
from rm3d_plugin.oversegmentation.region_growing import RegionGrowing
from rm3d_plugin.oversegmentation.tuning import Tuning, tune_region_growing
from rm3d_plugin.oversegmentation.vccs import VCCS

__all__ = [
    'VCCS',
    'CutPursuit',
    'GroundPatches',
    'Oversegmenter',
    'Precomputed',
    'RegionGrowing',
    'Tuning',
    'tune_region_growing',
]
