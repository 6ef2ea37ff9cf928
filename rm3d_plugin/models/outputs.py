"""What networks say of a batch; losses read it, and ``mode='tensor'`` hands it out."""

from typing import NamedTuple, Protocol, runtime_checkable

from jaxtyping import Float
from torch import Tensor

from rm3d_plugin.models.heads.vote_head import VoteOutput


@runtime_checkable
class FeatureOutput(Protocol):
    """What networks without classes say of points, too."""

    @property
    def features(self) -> Float[Tensor, 'points channels']:
        """Of the backbone."""


@runtime_checkable
class PointOutput(FeatureOutput, Protocol):
    """What every network of classes says of points; a loss that reads no more works with all of them."""

    @property
    def logits(self) -> Float[Tensor, 'points classes']:
        """Class scores."""


class SegmentorOutput(NamedTuple):
    """What the segmentor computed for a batch.

    Attributes:
        features: (N, F) of the backbone.
        logits: (N, C) class scores.
        offsets: (N, 3) metres from each point to the centre of its instance, or None without an instance head.
    """

    features: Float[Tensor, 'points channels']
    logits: Float[Tensor, 'points classes']
    offsets: Float[Tensor, 'points 3'] | None


class DetectorOutput(NamedTuple):
    """What the detector computed for a batch.

    Attributes:
        features: (N, F) of the backbone.
        logits: (N, C + 1) P_out, background last.
        votes: Output of the vote head.
        fits: (P,) log odds of the overlap of each decoded proposal with its object, or None without an IoU head.
    """

    features: Float[Tensor, 'points channels']
    logits: Float[Tensor, 'points classes_and_one']
    votes: VoteOutput
    fits: Float[Tensor, ' proposals'] | None = None
