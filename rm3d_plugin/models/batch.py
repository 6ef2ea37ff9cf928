"""What a network and its losses read of a batch."""

from typing import NamedTuple

from jaxtyping import Float, Int
from torch import Tensor

from rm3d_plugin.models.consistency.teacher import Teacher
from rm3d_plugin.models.consistency.view import View


class Batch(NamedTuple):
    """The scenes of a batch, points end to end.

    Attributes:
        points: (N, D) x, y, z in metres (each scene in its own frame, z up), then what the scans have.
        batch_offsets: (B + 1,) rows of the scenes.
        views: Further views of the same scenes; empty where the pipeline makes none, and at test time.
        teacher: What a teacher says of the batch; None where there is none, or not yet.
    """

    points: Float[Tensor, 'points columns']
    batch_offsets: Int[Tensor, ' scenes_and_one']
    views: tuple[View, ...] = ()
    teacher: Teacher | None = None

    @property
    def xyz(self) -> Float[Tensor, 'points 3']:
        """Metres."""
        return self.points[:, :3]

    @property
    def sizes(self) -> list[int]:
        """Points of each scene."""
        return self.batch_offsets.diff().tolist()
