"""The descriptors that tables compare, in the order of the paper's Table 1."""

from rm3d_plugin.descriptors import Descriptor
from rm3d_plugin.descriptors.learned import LearnedDescriptor
from rm3d_plugin.experiments.scenes import Collection
from rm3d_plugin.inference.oversegment import build_part
from rm3d_plugin.registry import DESCRIPTORS

ORDER = (
    'VisualSimilarity', 'HKS', 'SIHKS', 'FPFH', 'WKS', 'SHOT', 'VCCS', 'SuperpointGraph', 'PFH', 'PointSIFT',
    'SupervisedSuperpoint', 'Contrastive', 'Predator', 'AdaptedPFH',
)  # fmt: skip


def compared_descriptors() -> tuple[str, ...]:
    """Type names of those that work at once: registered, with weights in the package where they need any."""
    kinds = DESCRIPTORS.module_dict
    return tuple(name for name in ORDER if name in kinds and _has_weights(kinds[name]))


def _has_weights(kind: type[Descriptor]) -> bool:
    return not issubclass(kind, LearnedDescriptor) or kind.shipped().is_file()


def build_descriptor(name: str, collection: Collection) -> Descriptor:
    """A descriptor with the numbers that suit a collection."""
    part: Descriptor = build_part(DESCRIPTORS, name, collection.preset, collection.options.get(name, {}))
    return part
