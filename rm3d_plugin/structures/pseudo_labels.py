"""What training may read of a scene: true labels where annotated, pseudo labels elsewhere."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from rm3d_plugin.structures.boxes3d import Boxes3D

UNLABELLED = -1


@dataclass(frozen=True, eq=False)
class PseudoLabels:
    """Labels of one scene in one round.

    Attributes:
        semantic: (N,) int64 class of each point; -1 = unlabelled. In detection the number of box classes stands for
            background.
        instance: (N,) int64 row of ``boxes`` (detection) or instance number; -1 = none.
        point_is_annotated: (N,) bool, True where the class was annotated by the budget.
        confidence: (N,) float32 in [0, 1]; 1 for true labels, 0 where unlabelled.
        boxes: True and pseudo boxes, true ones first.
        box_is_annotated: (M,) bool.
        complete: True where every label of the scene is known, so that what has none is background.
        likeliest: (N,) int64 class that is likeliest, also where that is not sure enough to be a label; -1 =
            unknown. None: what made the labels does not say.
    """

    semantic: Int[np.ndarray, ' points']
    instance: Int[np.ndarray, ' points']
    point_is_annotated: Bool[np.ndarray, ' points']
    confidence: Float[np.ndarray, ' points']
    boxes: Boxes3D
    box_is_annotated: Bool[np.ndarray, ' boxes']
    complete: bool = False
    likeliest: Int[np.ndarray, ' points'] | None = None

    def __post_init__(self) -> None:
        n = len(self.semantic)
        for name in ('instance', 'point_is_annotated', 'confidence'):
            rows = len(getattr(self, name))
            if rows != n:
                raise ValueError(f'PseudoLabels.{name}: expected {n} rows (one a point), got {rows}')
        if self.likeliest is not None and len(self.likeliest) != n:
            raise ValueError(f'PseudoLabels.likeliest: expected {n} rows (one a point), got {len(self.likeliest)}')
        if len(self.box_is_annotated) != len(self.boxes):
            raise ValueError(
                f'PseudoLabels.box_is_annotated: expected {len(self.boxes)} rows, got {len(self.box_is_annotated)}'
            )

    def __len__(self) -> int:
        return len(self.semantic)

    @property
    def coverage(self) -> float:
        """Share of points with a label, in [0, 1]."""
        return float((self.semantic != UNLABELLED).mean()) if len(self) else 0.0
