"""Where making labels meets learning from them, in segmentation."""

from collections.abc import Iterator, Mapping
from functools import cached_property
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
import torch
from jaxtyping import Int

from rm3d_plugin.engine.base_labeler import BaseLabeler, PointPrediction, SceneLabels
from rm3d_plugin.engine.label_report import PointTruth, summarise_points
from rm3d_plugin.engine.sources import LabelSource
from rm3d_plugin.pseudo_labels import WeakLabels, refresh_points
from rm3d_plugin.registry import TASK_UTILS
from rm3d_plugin.structures import Boxes3D, PseudoLabels

Seeds = Literal['none', 'revealed']


@TASK_UTILS.register_module()
class PointLabeler(BaseLabeler):
    """Labels of segmentation: classes and instances of points, spread over regions (METHOD 1).

    Scenes of which everything is revealed keep their labels as they are.

    Args:
        store: Folder of the label store.
        cache: Folder of prepared geometry.
        source: A :class:`~rm3d_plugin.engine.sources.LabelSource` or its config.
        descriptor: Config of a descriptor provider.
        oversegmenter: Config of an over-segmenter.
        seeds: 'revealed': regions grow from the revealed points first, as the paper has it (METHOD 5). 'none': they
            depend on the geometry alone, so runs with other budgets or seeds share them.
        spread: False: training sees the revealed points alone (the weak baseline), no region is made.
        settings: Further arguments of :class:`BaseLabeler`.
    """

    def __init__(
        self,
        store: str | Path,
        cache: str | Path,
        source: Mapping[str, Any] | LabelSource,
        descriptor: Mapping[str, Any],
        oversegmenter: Mapping[str, Any],
        seeds: Seeds = 'revealed',
        spread: bool = True,
        **settings: Any,
    ) -> None:
        if seeds not in get_args(Seeds):
            raise ValueError(f'PointLabeler.seeds: expected one of {", ".join(get_args(Seeds))}, got {seeds!r}')
        super().__init__(store, cache, source, descriptor, oversegmenter, **settings)
        self.spread = spread
        self._seeds = seeds

    def needs_geometry(self) -> bool:
        """Whether labels spread over regions."""
        return self.spread

    def seeds(self, scene_id: str) -> Int[np.ndarray, ' seeds'] | None:
        """The revealed points, where the over-segmentation shall start from them; not those of a complete scene."""
        if self._seeds == 'none':
            return None
        weak = self.weak(scene_id)
        return None if weak.complete else np.flatnonzero(weak.semantic >= 0)

    @cached_property
    def class_counts(self) -> Int[np.ndarray, ' classes']:
        """Revealed points of each class."""
        return self.source.point_counts()

    def inform(self, model: Any) -> None:
        """Tell the model how often each class is revealed, where it asks for it."""
        if hasattr(model, 'set_class_counts'):
            model.set_class_counts(torch.from_numpy(self.class_counts))

    def make_labels(self, number: int, scene_id: str, prediction: PointPrediction | None) -> SceneLabels:
        """Merge regions and spread what is known over them."""
        weak = self.weak(scene_id)
        if weak.complete or not self.spread:
            return SceneLabels(revealed_only(weak), None)
        scene = self.prepared(scene_id)
        result = refresh_points(
            scene.cloud,
            scene.regions,
            scene.graph,
            weak,
            None if prediction is None else prediction.probabilities,
            None if prediction is None else prediction.centers,
            self.store.read(scene_id, number - 1) if number else None,
            self.strategy,
            number,
            self.class_counts,
            tuple(self.source.thing_classes),
        )
        return SceneLabels(result.labels, result.merge.ledger.to_arrays())

    def summarise_round(self, number: int) -> dict[str, Any]:
        """Coverage and precision of each class, and how far the centres of instances are off."""
        return summarise_points(self._judged(number), self.source.classes)

    def _judged(self, number: int) -> Iterator[tuple[PseudoLabels, PointTruth | None]]:
        for scene, index in self.index_of.items():
            truth = self.source.truth(index)
            known = None
            if truth is not None and truth.semantic is not None:
                known = PointTruth(self.source.load_cloud(index).xyz, truth.semantic, truth.instance)
            yield self.store.read(scene, number), known


def revealed_only(weak: WeakLabels) -> PseudoLabels:
    """The revealed labels and no other."""
    known = weak.semantic >= 0
    return PseudoLabels(
        semantic=weak.semantic,
        instance=weak.instance,
        point_is_true=known,
        confidence=known.astype(np.float32),
        boxes=Boxes3D.empty(),
        box_is_true=np.zeros(0, dtype=bool),
        complete=weak.complete,
    )
