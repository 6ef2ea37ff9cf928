"""Points that two views have in common, with their features and places."""

from typing import NamedTuple

import torch
from jaxtyping import Float, Int
from torch import Tensor

from rm3d_plugin.models.consistency import View, common_rows


class Matches(NamedTuple):
    """The same points in two views.

    Attributes:
        first: (M, F) features in the first view.
        second: (M, F) features in the further view.
        xyz: (M, 3) metres, places in the first view, z up.
        scene: (M,) scene of the batch.
    """

    first: Float[Tensor, 'matches channels']
    second: Float[Tensor, 'matches channels']
    xyz: Float[Tensor, 'matches 3']
    scene: Int[Tensor, ' matches']

    def of_scene(self, number: int) -> 'Matches':
        """Those of one scene."""
        rows = self.scene == number
        return Matches(*(values[rows] for values in self))

    def distances(self) -> Float[Tensor, 'matches matches']:
        """Metres between the places; infinite between scenes."""
        return torch.cdist(self.xyz, self.xyz).masked_fill(self.scene[:, None] != self.scene, torch.inf)


def match_views(
    features: Float[Tensor, 'points channels'],
    xyz: Float[Tensor, 'points 3'],
    batch_offsets: Int[Tensor, ' scenes_and_one'],
    view: View,
    count: int,
) -> Matches:
    """At most so many common points of the first and a further view, over the whole batch.

    Args:
        features: Of the first view.
        xyz: Of the first view, metres.
        batch_offsets: Rows of its scenes.
        view: The further view.
        count: See :func:`common_rows`, which draws them.
    """
    rows = common_rows(view.point_ids, count)
    points = view.point_ids[rows]
    scene = torch.bucketize(points, batch_offsets[1:], right=True)
    return Matches(features[points], view.features[rows], xyz[points], scene)
