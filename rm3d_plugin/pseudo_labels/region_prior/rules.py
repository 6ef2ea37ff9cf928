"""What a region may be before any network is asked: which evidence counts, and how much."""

from dataclasses import dataclass
from typing import Literal, get_args

from rm3d_plugin.structures.check_field import check_choice, check_field, check_positive, check_switches

RegionClassifier = Literal['neighbors', 'kernel']


@dataclass(frozen=True)
class RegionPriorRules:
    """The network's softmax is multiplied with what each region may be by its features and by annotated points nearby.

    In the first round that stands alone. A class of which a scene holds no annotated point is out, which is true of
    budgets that show one of each class there is, and not of clicks that leave out a class. Segmentation only.

    Attributes:
        classifier: 'neighbors': the most alike annotated regions vote, and colours count. 'kernel': a classifier that
            annotated regions of all scenes teach says how likely each class is, times how frequent it seems to be; for
            scenes of one sensor, whose ranges and brightness it sees, and budgets that show as many points of each
            class; with fewer than 15 annotated regions in all they vote.
        gamma: Confidence that prior and network together need, in place of ``MergeRules.gamma``: their product is no
            softmax. None: the same.
        distance_scale: Metres at which the distance prior of an annotated point has begun to decay, slowly, as suits
            scenes with many small things of a class. None: it decays as fast as regions of its class are short, which
            suits scenes where most things have an annotated point.
        inverse_temperature: The softmax is raised to this power before, so it counts so many times against the prior.
            Larger: trusts the network more, and regions are named more readily.
        heading: The sensor travels along x, as on vehicles: how far aside of its path things lie is a region feature.
        missing_points: A region that would hold so many annotated points, were they spread evenly, but holds none, is
            of no class, and nothing names it. For points annotated by chance, not class by class, where some things
            have no class. Smaller: less is labelled. None: any region may have a class.
        color_sigma: Lab distance at which the likeness of two colours has fallen to 1 / e.
        intensity_sigma: The same for a lidar's return strength in [0, 1].
    """

    classifier: RegionClassifier = 'neighbors'
    gamma: float | None = None
    distance_scale: float | None = None
    inverse_temperature: float = 1.0
    heading: bool = False
    missing_points: float | None = None
    color_sigma: float = 15.0
    intensity_sigma: float = 0.1

    def __post_init__(self) -> None:
        check_choice(self, 'classifier', get_args(RegionClassifier))
        check_field(self, 'gamma', self.gamma is None or 0 < self.gamma <= 1, 'a probability in (0, 1], or None')
        check_positive(self, 'distance_scale', 'missing_points', optional=True)
        check_positive(self, 'inverse_temperature', 'color_sigma', 'intensity_sigma')
        check_switches(self, 'heading')
