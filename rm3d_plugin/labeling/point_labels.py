"""Which label maker a segmentation config asks for."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal, get_args

from rm3d_plugin.labeling.annotated import AnnotatedLabelMaker
from rm3d_plugin.labeling.label_maker import LabelMaker
from rm3d_plugin.labeling.predicted import PredictedLabelMaker
from rm3d_plugin.labeling.segmentation import SegmentationLabelMaker
from rm3d_plugin.labeling.sources import LabelSource
from rm3d_plugin.labeling.walker import WalkerLabelMaker
from rm3d_plugin.pseudo_labels import segmentation_rules
from rm3d_plugin.pseudo_labels.common.strategy import Strategy
from rm3d_plugin.registry import TASK_UTILS

PointStrategy = Literal['default', 'regions', 'paper']
RULES = ('merge', 'propagation', 'region_prior', 'ground', 'self_training')
GEOMETRY = ('cache', 'descriptor', 'oversegmenter', 'graph_neighbors', 'max_gap')


@TASK_UTILS.register_module()
def point_label_maker(
    store: str | Path,
    source: Mapping[str, Any] | LabelSource,
    propagate: bool = True,
    strategy: PointStrategy = 'default',
    walker: Mapping[str, Any] | None = None,
    random_walk: Mapping[str, Any] | None = None,
    instances: bool = False,
    predicted: Mapping[str, Any] | None = None,
    **settings: Any,
) -> LabelMaker:
    """The label maker of a segmentation config.

    Args:
        store: Folder of the label store.
        source: A :class:`~rm3d_plugin.labeling.sources.LabelSource` or its config.
        propagate: False: training sees the annotated points alone (:class:`AnnotatedLabelMaker`), and the rest is not
            read.
        strategy: 'default': labels spread by a random walk (:class:`WalkerLabelMaker`). 'regions': regions merge, by
            the paper's rules and ours (:class:`SegmentationLabelMaker`). 'paper': by those of METHOD 6 alone.
        walker: Fields of :class:`~rm3d_plugin.labeling.walker.WalkerLabelRules`, read by 'default' alone as the next.
        random_walk: Fields of :class:`~rm3d_plugin.pseudo_labels.propagation.WalkerRules`.
        instances: Whether the walk carries instances, too; merged regions always do.
        predicted: Arguments of :class:`PredictedLabelMaker` beside those of the regions: self-training in rounds, where
            the strategy and the rest are not read. None: no self-training.
        settings: Further arguments of :class:`SegmentationLabelMaker`.

    Raises:
        ValueError: A value is not allowed, also one that the strategy does not read.
    """
    segmentation_rules(**{name: settings[name] for name in RULES if name in settings})
    geometry = {name: settings[name] for name in GEOMETRY if name in settings}
    if predicted is not None:
        return PredictedLabelMaker(store, source, **predicted, **geometry)
    if not propagate:
        return AnnotatedLabelMaker(store, source)
    if strategy not in get_args(PointStrategy):
        raise ValueError(f'strategy: expected one of {", ".join(get_args(PointStrategy))}, got {strategy!r}')
    if strategy != 'default':
        rules: Strategy = 'paper' if strategy == 'paper' else 'default'
        return SegmentationLabelMaker(store, source, rules, **settings)
    rounds, seed = int((settings.get('merge') or {}).get('rounds') or 1), settings.get('seed', 0)
    return WalkerLabelMaker(store, source, rounds, walker, random_walk, instances, seed, **geometry)
