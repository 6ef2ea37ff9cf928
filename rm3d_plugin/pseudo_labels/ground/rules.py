"""When ground is named point by point, and how."""

from dataclasses import dataclass
from typing import Literal, get_args

from rm3d_plugin.structures.check_field import check_choice, check_field, check_positive, check_switches

GroundClassifier = Literal['nearest', 'kernel']


@dataclass(frozen=True)
class GroundRules:
    """Road and pavement lie in one plane, so no region ends where they meet: points of the ground are named one by one.

    Attributes:
        min_upright: Regions whose mean normal is this upright (its z in [0, 1]) are ground. Smaller: slopes too.
        classifier: 'nearest': each point takes the class of the nearest annotated one, with differences of height, as
            of a kerb, counted more; after the first round what the network and those distances say together. 'kernel':
            what annotated ground points of all scenes teach names them, in the first round and for good; where hardly
            any are annotated it is as 'nearest'.
        max_distance: Metres up to which an annotated point names ground points in the first round. Larger: more and
            less pure labels. None: no limit.
        heading: The sensor travels along x, as on vehicles, and streets run that way: sides are those of its path.
    """

    min_upright: float = 0.95
    classifier: GroundClassifier = 'nearest'
    max_distance: float | None = None
    heading: bool = False

    def __post_init__(self) -> None:
        check_field(self, 'min_upright', 0 <= self.min_upright <= 1, 'in [0, 1]')
        check_choice(self, 'classifier', get_args(GroundClassifier))
        check_positive(self, 'max_distance', optional=True)
        check_switches(self, 'heading')
