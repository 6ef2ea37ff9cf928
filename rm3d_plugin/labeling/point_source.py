"""A few labelled points of a segmentation data set, or what a person clicked."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Int
from mmengine.dist import is_main_process
from tqdm import tqdm

from rm3d_plugin.datasets.base import Truth
from rm3d_plugin.label_budgets import (
    AnnotatedPoints,
    BudgetError,
    PointAmount,
    PointBudget,
    budget_from_clicks,
    draw_point_budget,
    hide_points,
    import_point_list,
    load_point_budget,
    point_amount,
    save_point_budget,
)
from rm3d_plugin.label_budgets.clicks import TOLERANCE
from rm3d_plugin.label_budgets.edited_clicks import added_clicks, describe_added
from rm3d_plugin.labeling.sources import DatasetSource
from rm3d_plugin.pseudo_labels import AnnotatedLabels
from rm3d_plugin.registry import TASK_UTILS
from rm3d_plugin.storage import read_clicks
from rm3d_plugin.structures import UNLABELLED, Boxes3D, PointCloud, SceneError


@TASK_UTILS.register_module()
class PointBudgetSource(DatasetSource):
    """A few points of a segmentation data set, drawn by seed (METHOD 8), listed in a file, or clicked.

    Args:
        dataset: The training split (a :class:`~rm3d_plugin.datasets.segmentation.SegmentationDataset`) or its config;
            its truth is read here to show the drawn points, and for reports. With clicks it need not exist.
        budget: 'onept', '20pts', '0p2pct', 'scenes5pct', 'onept_instance', 'full', ..., or the fields of a
            :class:`~rm3d_plugin.label_budgets.PointAmount`: ``dict(clicks='my.csv')``, ``dict(point_list='points20')``.
        seed: Seed of the draw.
        click_tolerance: Metres between a clicked place and the nearest point; larger: more is forgiven. None: 0.05 m,
            and where the data set thins its points the diagonal of a voxel more.
        add_clicks: A resumed run goes on with clicks that were added to its file: the next round of labels is made with
            them. False: added clicks are an error that tells them.
    """

    def __init__(
        self,
        dataset: Any,
        budget: str | Mapping[str, Any] = '0p2pct',
        seed: int = 0,
        click_tolerance: float | None = None,
        add_clicks: bool = False,
    ) -> None:
        super().__init__(dataset)
        self.thing_classes = tuple(self.dataset.thing_classes)
        self._amount = point_amount(budget)
        self._seed = seed
        voxel = self.dataset.voxel_downsample or 0.0
        self._tolerance = TOLERANCE + 3**0.5 * voxel if click_tolerance is None else click_tolerance
        if add_clicks and self._amount.clicks is None:
            raise BudgetError(f'add_clicks: the label budget is no file of clicks, but {self._amount}')
        self._add_clicks = add_clicks
        self._budget: PointBudget | None = None
        self._grown: PointBudget | None = None  # with the clicks that were added, until a round is made with them
        self._file: Path | None = None
        self._told = ''
        self._index = {scene: index for index, scene in enumerate(self.scene_ids)}
        self._sizes: dict[int, int] = {}

    @property
    def budget(self) -> PointBudget:
        """The annotated points; drawn or read at first use."""
        if self._budget is None:
            self._budget = self._make()
        return self._budget

    @property
    def amount(self) -> PointAmount:
        """What the budget asks for."""
        return self._amount

    def point_counts(self) -> Int[np.ndarray, ' classes']:
        """Annotated points of each class."""
        counts = np.zeros(len(self.classes), dtype=np.int64)
        for number, count in self.budget.annotated_per_class.items():
            counts[number] = count
        return counts

    def annotated(self, index: int, points: int) -> AnnotatedPoints:
        """Annotated points of a scene that has ``points`` points."""
        scene = self.scene_ids[index]
        if scene not in self.budget.complete:
            return self.budget.points_of(scene, points)
        self.budget.check(scene, points)
        return hide_points(self.dataset.load_truth(index), np.arange(points), self._amount.instances)

    def annotated_labels(self, index: int) -> AnnotatedLabels:
        """Class and instance of the annotated points of a scene; -1 elsewhere."""
        if index not in self._sizes:
            self._sizes[index] = len(self.load_cloud(index))
        points = self._sizes[index]
        shown = self.annotated(index, points)
        semantic, instance = np.full((2, points), UNLABELLED, dtype=np.int64)
        semantic[shown.points], instance[shown.points] = shown.semantic, shown.instance
        return AnnotatedLabels(
            semantic, instance, Boxes3D.empty(), complete=self.scene_ids[index] in self.budget.complete
        )

    def truth(self, index: int) -> Truth | None:
        """All labels of a scene, for reports; None for a clicked scene of which nobody knows the other labels."""
        if self._amount.clicks is None:
            return super().truth(index)
        try:
            return super().truth(index)
        except SceneError:
            return None

    def rows_of(self, scene_id: str) -> Int[np.ndarray, ' original']:
        """Row of a scene's points that stands for each point of the original file."""
        rows: Int[np.ndarray, ' original'] = self.dataset.original_index(self._index[scene_id])
        return rows

    def describe(self) -> str:
        """The budget's summary, after what was added to it."""
        return self._told + self.budget.summary(self.classes)

    def open(self, folder: Path, resume: bool) -> None:
        """Write ``budget.json`` and ``budget.npz``, or read them.

        Raises:
            BudgetError: What is kept there is not the budget that is asked for, or the file of clicks was edited.
        """
        self._file = folder / 'budget.json'
        if resume:
            self._budget = self._checked(load_point_budget(self._file), folder)
            self._grown = None if self._amount.clicks is None else self._with_added(self._budget, self._amount.clicks)
        else:
            save_point_budget(self._file, self.budget)

    @property
    def grown(self) -> bool:
        """Whether clicks were added to the file."""
        return self._grown is not None

    def extend(self, number: int, seen: Mapping[str, Any]) -> None:
        """Show the clicks that were added."""
        assert self._grown is not None and self._file is not None, 'extend: no click was added'
        self._budget, self._grown = self._grown, None
        if is_main_process():
            save_point_budget(self._file, self._budget)

    def _with_added(self, kept: PointBudget, path: str) -> PointBudget | None:
        """The budget of the file as it is now; None where it is the one that was kept."""
        now = self._make()
        added = added_clicks(kept, now, path, self.classes)
        if not added:
            if self._add_clicks:
                raise BudgetError(f'{path}: no click was added since the run read it; resume without --add-clicks')
            return None
        told = f'{path}: clicks were added: {describe_added(added, self.classes)}'
        if not self._add_clicks:
            raise BudgetError(f'{told}; go on with them by --resume --add-clicks, or take them out of the file')
        self._told = f'{told}; the next round of labels is made with them\n'
        return now

    def _make(self) -> PointBudget:
        bar = tqdm(total=len(self.scene_ids), desc='the label budget', leave=False)

        def truth_of(scene: str) -> Truth:
            bar.update()
            truth: Truth = self.dataset.load_truth(self._index[scene])
            return truth

        def cloud_of(scene: str) -> PointCloud:
            bar.update()
            return self.load_cloud(self._index[scene])

        with bar:
            if self._amount.clicks is not None:
                clicks = read_clicks(self._amount.clicks, self.classes)
                return budget_from_clicks(
                    self.scene_ids, cloud_of, clicks, self._amount, self._seed, self._tolerance, self.rows_of
                )
            if self._amount.file is not None:
                return import_point_list(self.scene_ids, truth_of, self._amount, self._seed, self.rows_of)
            return draw_point_budget(self.scene_ids, truth_of, self._amount, self._seed)

    def _checked(self, kept: PointBudget, folder: Path) -> PointBudget:
        if (kept.seed, kept.amount) != (self._seed, self._amount):
            raise BudgetError(
                f'{folder / "budget.json"}: was drawn with seed {kept.seed} and {kept.amount}, but seed {self._seed} '
                f'and {self._amount} are asked for; resume with the settings of that run, or start in another work dir'
            )
        return kept
