"""Reading scenes at test time: whole or in chunks, from one or several sides."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import torch
from jaxtyping import Float
from mmengine.structures import BaseDataElement
from torch import Tensor

from rm3d_plugin.models.batch import Batch
from rm3d_plugin.models.outputs import SegmentorOutput
from rm3d_plugin.models.segmentors.chunks import Chunk, Progress
from rm3d_plugin.models.segmentors.point_inputs import PointInputs, point_inputs
from rm3d_plugin.models.segmentors.scene_inference import (
    Predict,
    SceneInference,
    average_views,
    by_class_frequency,
    mix_regions,
)
from rm3d_plugin.structures import SceneError


class ReadScene(NamedTuple):
    """What was read of one scene, on the CPU.

    Attributes:
        xyz: (n, 3) metres.
        probs: (n, C) softmax, the mean over chunks and views.
        features: (n, F) of the backbone, the same mean; None where they are not asked for.
        offsets: (n, 3) metres to the centres of instances, the same mean; None without an instance head.
        chunks: In which the scene was read.
    """

    xyz: Float[Tensor, 'points 3']
    probs: Float[Tensor, 'points classes']
    features: Float[Tensor, 'points channels'] | None
    offsets: Float[Tensor, 'points 3'] | None
    chunks: Sequence[Chunk]


@dataclass(frozen=True)
class SceneReader:
    """Backbone and heads of a segmentor, asked as ``inference`` says.

    Attributes:
        inputs: What the backbone reads of a point.
        num_classes: C.
        num_features: F, columns of the features where they are asked for, else 0.
        inference: Chunks and views.
        backbone: ``(xyz, columns, batch_offsets) -> features``.
        heads: Features -> what is said of the points.
        progress: Hands on the chunks of a scene.
    """

    inputs: PointInputs
    num_classes: int
    num_features: int
    inference: SceneInference
    backbone: Callable[[Tensor, Tensor, Tensor], Tensor]
    heads: Callable[[Tensor], SegmentorOutput]
    progress: Progress

    def read(self, batch: Batch, once: bool) -> Iterator[ReadScene]:
        """Scene by scene; a batch that needs neither chunks nor views goes through the network at once.

        Args:
            batch: Scenes.
            once: From the first side only.
        """
        plain = all(self.inference.is_plain(size) for size in batch.sizes)
        together = self._said(batch.points, batch.batch_offsets).cpu().split(batch.sizes) if plain else None
        for number, points in enumerate(batch.points.split(batch.sizes)):
            xyz = points[:, :3].cpu()
            chunks = self.inference.chunks(xyz.numpy())
            values = self._averaged(points, chunks, once) if together is None else together[number]
            sizes = (self.num_classes, self.num_features, values.shape[1] - self._scalars)
            probs, *rest = (part.clone() for part in values.split(sizes, dim=1))
            features, offsets = (part if part.shape[1] else None for part in rest)
            yield ReadScene(xyz, probs, features, offsets, chunks)

    @property
    def _scalars(self) -> int:
        """Columns that are the same from every side."""
        return self.num_classes + self.num_features

    def _joined(self, output: SegmentorOutput) -> Float[Tensor, 'points values']:
        """Probabilities, then features where they are asked for, then offsets where there are any."""
        parts = (output.logits.softmax(dim=1), output.features[:, : self.num_features].float(), output.offsets)
        return torch.cat([part for part in parts if part is not None], dim=1)

    def _columns(self, points: Tensor, batch_offsets: Tensor) -> Tensor:
        return point_inputs(points, batch_offsets, self.inputs)

    def _said(self, points: Tensor, batch_offsets: Tensor) -> Float[Tensor, 'points values']:
        columns = self._columns(points, batch_offsets)
        return self._joined(self.heads(self.backbone(points[:, :3], columns, batch_offsets)))

    def _averaged(self, points: Tensor, chunks: Sequence[Chunk], once: bool) -> Float[Tensor, 'points values']:
        if not chunks:
            return self._said(points, points.new_zeros(2).long()).cpu()
        views = self.inference.one_view if once else self.inference.views
        return average_views(points, views, chunks, self._look, self._scalars, self.progress)

    def _look(self, points: Tensor) -> Predict:
        """A view of a scene, as a function that predicts some of its rows.

        What a point is told of its place in the scene is the same in every chunk.
        """
        columns = self._columns(points, torch.tensor([0, len(points)], device=points.device))

        def predict(rows: Tensor) -> Tensor:
            rows = rows.to(points.device)
            ends = torch.tensor([0, len(rows)], device=points.device)
            return self._joined(self.heads(self.backbone(points[rows, :3], columns[rows], ends)))

        return predict


def settled(
    probs: Float[Tensor, 'points classes'],
    sample: BaseDataElement,
    inference: SceneInference,
    class_counts: Float[Tensor, ' classes'],
) -> Float[Tensor, 'points classes']:
    """What regions and how often classes are have to say to the network's probabilities.

    Args:
        probs: Of one scene.
        sample: Holds ``pts_region`` where ``inference.superpoint_smoothing`` asks for it.
        inference: How much they have to say.
        class_counts: Annotated labels of each class.

    Raises:
        SceneError: The regions of the points are not there.
    """
    if inference.superpoint_smoothing:
        if 'pts_region' not in sample:
            raise SceneError(
                f'scene {sample.get("scene_id", "")}: inference.superpoint_smoothing wants pts_region of each '
                'point; put RegionNumbers into the pipeline, or set superpoint_smoothing=0'
            )
        probs = mix_regions(probs, sample.pts_region.cpu(), inference.superpoint_smoothing)
    if inference.logit_adjustment:
        probs = by_class_frequency(probs, class_counts, inference.logit_adjustment)
    return probs
