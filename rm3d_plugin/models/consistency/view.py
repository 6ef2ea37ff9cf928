"""A further view of a batch, with what the network says of it on demand."""

from collections.abc import Callable
from functools import cached_property

from jaxtyping import Float, Int
from torch import Tensor

Encode = Callable[[Tensor, Tensor], Tensor]
Classify = Callable[[Tensor], Tensor]


class View:
    """Other coordinates and colours of some points of a batch.

    The network sees a view when the first loss asks for it, and once, however many ask.

    Args:
        points: (m, D) as the points of the first view.
        batch_offsets: (B + 1,) rows of the scenes among them; a scene may have none.
        point_ids: (m,) the row of the first view's points that each is, -1: of none (crops of a scan).
        encode: ``(points, batch_offsets) -> features``; leaves the running statistics alone.
        classify: Features of points -> logits.
    """

    def __init__(
        self,
        points: Float[Tensor, 'view columns'],
        batch_offsets: Int[Tensor, ' scenes_and_one'],
        point_ids: Int[Tensor, ' view'],
        encode: Encode,
        classify: Classify,
    ) -> None:
        self.points, self.batch_offsets, self.point_ids = points, batch_offsets, point_ids
        self._encode, self._classify = encode, classify

    @cached_property
    def features(self) -> Float[Tensor, 'view channels']:
        """What the backbone says of the points."""
        return self._encode(self.points, self.batch_offsets)

    def logits(self, rows: Int[Tensor, ' rows'] | None = None) -> Float[Tensor, 'rows classes']:
        """Class scores of the points, or of some of them."""
        return self._classify(self.features if rows is None else self.features[rows])
