"""What a refresh knew when it decided, region by region: enough to decide again with other thresholds."""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields

import numpy as np
from jaxtyping import Bool, Float, Int

from rm3d_plugin.pseudo_labels.common.groups import GroupLabels, Pooled, label_groups
from rm3d_plugin.pseudo_labels.common.self_training import SelfTrainingRules
from rm3d_plugin.regions import MergeRules, RegionEvidence

_OPTIONAL = ('centers', 'outside', 'class_gamma', 'named')
_RULES = ('merge', 'self_training')


@dataclass(frozen=True, eq=False)
class RefreshRecord:
    """R regions, C classes, N points.

    Attributes:
        curvatures: (R,) the order of seeds.
        ranges: (R,) mean distance of the points to the sensor, metres.
        labels: (R,) annotated class, -1 = unknown.
        instances: (R,) annotated instance, -1 = unknown.
        probabilities: (R, C) pooled softmax, NaN where nothing was predicted.
        centers: (R, 3) pooled shifted centres, or None.
        outside: (R, C) pooled softmax without the points that a box tells exactly; None: the same as probabilities.
        seen: (R,) points pooled in ``outside``.
        votes: (R, C) annotated labels that propagate, by class.
        class_counts: (C,) annotated labels of each class; breaks ties.
        class_gamma: (C,) confidence that each class asks for beside gamma, or None.
        named: (R,) bool, regions whose points were named one by one; None: none.
        point_region: (N,) int32 region of each point, -1 = none.
        merge: Rules of merging.
        self_training: How new labels were limited, or None.
        round: The round.
    """

    curvatures: Float[np.ndarray, ' regions']
    ranges: Float[np.ndarray, ' regions']
    labels: Int[np.ndarray, ' regions']
    instances: Int[np.ndarray, ' regions']
    probabilities: Float[np.ndarray, 'regions classes']
    centers: Float[np.ndarray, 'regions 3'] | None
    outside: Float[np.ndarray, 'regions classes'] | None
    seen: Int[np.ndarray, ' regions']
    votes: Int[np.ndarray, 'regions classes']
    class_counts: Int[np.ndarray, ' classes']
    class_gamma: Float[np.ndarray, ' classes'] | None
    named: Bool[np.ndarray, ' regions'] | None
    point_region: Int[np.ndarray, ' points']
    merge: MergeRules
    self_training: SelfTrainingRules | None
    round: int

    def evidence(self) -> RegionEvidence:
        """What merging was given."""
        return RegionEvidence(self.probabilities, self.labels, self.instances, self.centers)

    def label(self, group: Int[np.ndarray, ' regions'], gamma: float) -> GroupLabels:
        """Class of each group of regions by rules (a), (b) and (c), see :func:`label_groups` (METHOD 1)."""
        rows = self.probabilities if self.outside is None else self.outside
        return label_groups(group, Pooled(rows, self.seen), self.votes, self.class_counts, gamma)

    def to_arrays(self) -> dict[str, np.ndarray]:
        """Arrays by name, for an npz file; what is None is left out."""
        out = {name: value for name, value in vars(self).items() if isinstance(value, np.ndarray)}
        given = {name: getattr(self, name) for name in _RULES}
        text = json.dumps({name: None if rules is None else asdict(rules) for name, rules in given.items()})
        return out | {'round': np.array(self.round), 'rules': np.frombuffer(text.encode(), dtype=np.uint8)}

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, np.ndarray]) -> 'RefreshRecord':
        """Undo :meth:`to_arrays`.

        Raises:
            ValueError: An array is missing.
        """
        names = [item.name for item in fields(cls) if item.name not in _RULES]
        needed = [name for name in (*names, 'rules') if name not in _OPTIONAL]
        if missing := [name for name in needed if name not in arrays]:
            raise ValueError(f'RefreshRecord: {missing} are missing; the ledger was written without a record to replay')
        rules = json.loads(arrays['rules'].tobytes())
        limits = rules['self_training']
        plain = {name: arrays.get(name) for name in names if name != 'round'}
        return cls(
            **plain,  # type: ignore[arg-type]
            merge=MergeRules(**rules['merge']),
            self_training=None if limits is None else SelfTrainingRules(**limits),
            round=int(arrays['round']),
        )
