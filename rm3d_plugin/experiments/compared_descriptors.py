"""The descriptors that tables compare, in the order of the paper's Table 1."""

from rm3d_plugin.descriptors import Descriptor
from rm3d_plugin.descriptors.learned import LearnedDescriptor
from rm3d_plugin.engine.config import ConfigError
from rm3d_plugin.experiments.scenes import Collection
from rm3d_plugin.experiments.spec import Request
from rm3d_plugin.inference.oversegment import build_part
from rm3d_plugin.registry import DESCRIPTORS

ORDER = (
    'VisualSimilarity', 'HKS', 'SIHKS', 'FPFH', 'WKS', 'SHOT', 'VCCS', 'SuperpointGraph', 'PFH', 'PointSIFT',
    'SupervisedSuperpoint', 'Contrastive', 'Predator', 'AdaptedPFH',
)  # fmt: skip
BEYOND = ('Semantic',)  # not of the paper: rows where they are asked for by name


def compared_descriptors() -> tuple[str, ...]:
    """Type names of those that work at once: registered, with weights in the package where they need any."""
    kinds = DESCRIPTORS.module_dict
    return tuple(name for name in ORDER if name in kinds and _has_weights(kinds[name]))


def named_descriptors() -> tuple[str, ...]:
    """Those, and others that can be asked for by name."""
    return *compared_descriptors(), *BEYOND


def asked_descriptors(request: Request) -> tuple[str, ...]:
    """The rows that a request asks for, in the order of the tables.

    Raises:
        ConfigError: A name is not among :func:`named_descriptors`.
    """
    names = named_descriptors()
    if unknown := sorted(set(request.descriptors) - set(names)):
        raise ConfigError(f'descriptors: expected some of {", ".join(names)}; got {", ".join(unknown)}')
    return tuple(name for name in names if name in request.descriptors) or compared_descriptors()


def _has_weights(kind: type[Descriptor]) -> bool:
    return not issubclass(kind, LearnedDescriptor) or kind.shipped().is_file()


def build_descriptor(name: str, collection: Collection) -> Descriptor:
    """A descriptor with the numbers that suit a collection."""
    part: Descriptor = build_part(DESCRIPTORS, name, collection.preset, collection.options.get(name, {}))
    return part
