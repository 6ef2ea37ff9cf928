"""Labels that are asked for round by round, where the network and the surface promise most."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

import numpy as np
from jaxtyping import Float, Int
from mmengine.dist import is_main_process

from rm3d_plugin.baselines.redal.score import alike, asked_of_regions, class_entropy, surface_interest
from rm3d_plugin.datasets.base import Truth
from rm3d_plugin.label_budgets import PointBudget, grown, load_point_budget, part_of, save_point_budget
from rm3d_plugin.labeling.accept import region_means
from rm3d_plugin.labeling.point_source import PointBudgetSource
from rm3d_plugin.labeling.prepared_scenes import PreparedScenes
from rm3d_plugin.ops.segment import segment_sizes
from rm3d_plugin.pseudo_labels import PointPrediction
from rm3d_plugin.registry import TASK_UTILS


class RegionView(NamedTuple):
    """What is known of the regions of a scene.

    Attributes:
        score: Mean over the points of entropy, colour gradient and surface variation.
        features: Mean of the network's features.
    """

    score: Float[np.ndarray, ' regions']
    features: Float[np.ndarray, 'regions channels']


@TASK_UTILS.register_module()
class RegionRoundsSource(PointBudgetSource):
    """A drawn budget in parts: the first by chance, the others where a region's score is highest.

    Each round adds as many points, so that the last has as many as the budget draws for others. A region shows one
    point, by chance, which tells nothing of where its labels lie. Points of no region are never asked for; one without
    a class shows nothing, and the next round asks for another in its place.

    Args:
        dataset: See :class:`PointBudgetSource`, as the next two.
        budget: How much is annotated in the end.
        seed: Of the draw, of the clusters and of the points in a region.
        rounds: Sets of labels in the whole run.
        geometry: Arguments of :class:`~rm3d_plugin.labeling.prepared_scenes.PreparedScenes`.
    """

    reads_features: ClassVar[bool] = True

    def __init__(
        self, dataset: Any, budget: str | Mapping[str, Any], seed: int, rounds: int, geometry: Mapping[str, Any]
    ) -> None:
        super().__init__(dataset, budget, seed)
        self._rounds = rounds
        self._total: int | None = None
        self._scenes = PreparedScenes(lambda scene: self.load_cloud(self._index[scene]), lambda scene: None, **geometry)
        self._surface: dict[str, Float[np.ndarray, ' regions']] = {}

    def _make(self) -> PointBudget:
        drawn = super()._make()
        self._total = drawn.annotated_count
        return part_of(drawn, self.points_after(0), np.random.default_rng([self._seed, 0]))

    def points_after(self, number: int) -> int:
        """Annotated points of all scenes in the labels of a round; in the last those that the budget draws for others.

        Args:
            number: The round, from 0.
        """
        if self._total is None:  # a resumed run: only the number is kept of what is drawn
            self._total = super()._make().annotated_count
        return max(round(self._total * (number + 1) / self._rounds), 1)

    def open(self, folder: Path, resume: bool) -> None:
        """Write the first part, or read what was annotated last."""
        super().open(folder, resume)
        if not resume:
            save_point_budget(self._kept(0), self.budget)

    def _kept(self, number: int) -> Path:
        """What was annotated for a round: a round that is made again grows from the same."""
        assert self._file is not None, 'RegionRoundsSource: open it first'
        return self._file.with_name(f'budget_round{number}.json')

    def extends(self, number: int) -> bool:
        """Before every round but the first."""
        return 0 < number < self._rounds

    def look(self, scene_id: str, prediction: PointPrediction) -> RegionView:
        """The regions of a scene.

        Raises:
            ValueError: The prediction has no features.
        """
        if prediction.features is None:
            raise ValueError(
                'RegionRoundsSource: the prediction has no pred_point_features; the model must give them where its '
                'predict_features is set, as RM3DSegmentor does'
            )
        scene = self._scenes.get(scene_id)
        if scene_id not in self._surface:
            self._surface[scene_id] = region_means(surface_interest(scene.cloud)[:, None], scene.regions)[:, 0]
        entropy = region_means(class_entropy(prediction.probabilities)[:, None], scene.regions)[:, 0]
        return RegionView(entropy + self._surface[scene_id], region_means(prediction.features, scene.regions))

    def extend(self, number: int, seen: Mapping[str, RegionView]) -> None:
        """Ask for the points of a round, and for others in place of those that have no class."""
        rng = np.random.default_rng([self._seed, number])
        clusters = alike(np.concatenate([seen[name].features for name in sorted(seen)]), rng)
        budget = load_point_budget(self._kept(number - 1))
        tried = {name: points.points for name, points in budget.annotated.items()}
        while left := max(self.points_after(number) - budget.annotated_count, 0):
            asked = self.asked(left, tried, seen, clusters, rng)
            if not any(map(len, asked.values())):
                break
            budget = grown(budget, self._truth_of, asked)
            tried = {name: np.union1d(rows, asked.get(name, rows[:0])) for name, rows in tried.items()}
        self._budget = budget
        if is_main_process():
            save_point_budget(self._kept(number), budget)
            save_point_budget(self._kept(0).with_name('budget.json'), budget)

    def _truth_of(self, scene_id: str) -> Truth:
        truth: Truth = self.dataset.load_truth(self._index[scene_id])
        return truth

    def asked(
        self,
        count: int,
        tried: Mapping[str, Int[np.ndarray, ' tried']],
        seen: Mapping[str, RegionView],
        clusters: Int[np.ndarray, ' regions'],
        rng: np.random.Generator,
    ) -> dict[str, Int[np.ndarray, ' asked']]:
        """Points to ask for, scene by scene.

        Args:
            count: In all scenes.
            tried: Scene -> points that are annotated, or that were asked for and have no class.
            seen: Regions of every scene.
            clusters: Of the regions of all scenes, in the order of their names.
            rng: Chooses the points.
        """
        names = sorted(seen)
        shown, free = np.concatenate([self._counts(name, tried[name]) for name in names], axis=1)
        scores = np.concatenate([seen[name].score for name in names])
        wanted = asked_of_regions(scores, clusters, shown, free, count)
        parts = np.split(wanted, np.cumsum([len(seen[name].score) for name in names])[:-1])
        return {name: self._points(name, tried[name], own, rng) for name, own in zip(names, parts, strict=True)}

    def _counts(self, scene_id: str, tried: Int[np.ndarray, ' tried']) -> Int[np.ndarray, '2 regions']:
        """Points of each region that were tried, and that were not."""
        regions = self._scenes.get(scene_id).regions
        shown = segment_sizes(regions.labels[tried], len(regions))
        return np.stack([shown, segment_sizes(regions.labels, len(regions)) - shown])

    def _points(
        self,
        scene_id: str,
        tried: Int[np.ndarray, ' tried'],
        wanted: Int[np.ndarray, ' regions'],
        rng: np.random.Generator,
    ) -> Int[np.ndarray, ' asked']:
        """So many points of each region, by chance, none of them tried."""
        labels = self._scenes.get(scene_id).regions.labels
        order = rng.permutation(np.setdiff1d(np.flatnonzero(labels >= 0), tried))
        order = order[np.argsort(labels[order], kind='stable')]
        place = np.arange(len(order)) - np.searchsorted(labels[order], labels[order])
        return np.sort(order[place < wanted[labels[order]]])
