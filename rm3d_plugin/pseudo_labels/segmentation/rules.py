"""Every rule of a segmentation run's labels: the paper's alone, or with ours."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from rm3d_plugin.pseudo_labels.common.self_training import SelfTrainingRules
from rm3d_plugin.pseudo_labels.common.strategy import Strategy, is_paper, optional_rules, with_gamma
from rm3d_plugin.pseudo_labels.ground.rules import GroundRules
from rm3d_plugin.pseudo_labels.region_prior.rules import RegionPriorRules
from rm3d_plugin.pseudo_labels.segmentation.propagation import PropagationRules
from rm3d_plugin.regions import MergeRules


@dataclass(frozen=True)
class SegmentationRules:
    """How labels of points are made; a part that is None is off.

    Attributes:
        merge: How regions merge (the paper).
        propagation: How far annotated points speak for their regions.
        region_prior: What regions may be before the network is asked.
        ground: When points of the ground are named one by one.
        self_training: How a round's new labels are limited and checked.
    """

    merge: MergeRules
    propagation: PropagationRules | None = None
    region_prior: RegionPriorRules | None = None
    ground: GroundRules | None = None
    self_training: SelfTrainingRules | None = None


def segmentation_rules(
    strategy: Strategy = 'default',
    merge: Mapping[str, Any] | None = None,
    propagation: Mapping[str, Any] | None = None,
    region_prior: Mapping[str, Any] | None = None,
    ground: Mapping[str, Any] | None = None,
    self_training: Mapping[str, Any] | None = None,
) -> SegmentationRules:
    """The rules of a run from the fields that its config gives.

    Args:
        strategy: 'paper': ``merge`` alone, the method as METHOD 6 has it; the rest is not read. 'default': all.
        merge: Fields of :class:`~rm3d_plugin.regions.MergeRules`.
        propagation: Fields of :class:`PropagationRules`, or None; as the rest.
        region_prior: Fields of :class:`RegionPriorRules`. Its ``gamma`` takes the place of that of
            ``merge``, which is then left out.
        ground: Fields of :class:`GroundRules`.
        self_training: Fields of :class:`SelfTrainingRules`.

    Raises:
        ValueError: A value is not allowed; the message names class and field.
    """
    merging = MergeRules(**(merge or {}))
    if is_paper(strategy):
        return SegmentationRules(merging)
    prior = optional_rules(RegionPriorRules, region_prior)
    gamma = None if prior is None else prior.gamma
    return SegmentationRules(
        with_gamma(merging, merge, gamma, 'RegionPriorRules.gamma'),
        optional_rules(PropagationRules, propagation),
        prior,
        optional_rules(GroundRules, ground),
        optional_rules(SelfTrainingRules, self_training),
    )
