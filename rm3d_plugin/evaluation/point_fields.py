"""Reading point labels and predictions of a sample, on the points that the truth is about."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from jaxtyping import Float, Int

from rm3d_plugin.class_names import check_class_names
from rm3d_plugin.ops.segment import scatter_rows
from rm3d_plugin.structures import SceneError, evaluated_fields


@dataclass(frozen=True, eq=False)
class PointTruth:
    """True labels, and which of them each predicted row is about.

    Attributes:
        semantic: (N,) int64.
        instance: (N,) int64, or None where the sample has none.
        index: (n,) int64 point of the scene for each predicted row.
        original: (N,) int64 point of the scene that stands for each row of the truth; None: they are the same.
    """

    semantic: Int[np.ndarray, ' points']
    instance: Int[np.ndarray, ' points'] | None
    index: Int[np.ndarray, ' rows']
    original: Int[np.ndarray, ' points'] | None = None

    @property
    def scene_points(self) -> int:
        """Points of the scene."""
        return len(self.semantic) if self.original is None else int(self.original.max(initial=-1)) + 1

    def scatter(self, rows: np.ndarray, missing: float) -> np.ndarray:
        """Predicted rows on the points of the truth; ``missing`` for points that were not predicted."""
        out = scatter_rows(rows, self.index, self.scene_points, missing)
        return out if self.original is None else out[self.original]


def numpy_of(values: Any) -> np.ndarray:
    """A tensor or anything array-like as an array; bfloat16, which numpy lacks, becomes float32."""
    if not isinstance(values, torch.Tensor):
        return np.asarray(values)
    tensor = values.detach().cpu()
    array: np.ndarray = (tensor.float() if tensor.dtype == torch.bfloat16 else tensor).numpy()
    return array


def fields_of(sample: Any, needed: Sequence[str], metric: str) -> Mapping[str, Any]:
    """The fields of a sample of ours or of mmdetection3d, with the truth that it is evaluated against.

    Raises:
        SceneError: One of ``needed`` is absent.
    """
    fields = evaluated_fields(sample)
    if missing := [name for name in needed if fields.get(name) is None]:
        raise SceneError(
            f'{metric}: scene {fields.get("scene_id", "")}: the sample has no {", ".join(missing)}; the model writes '
            "pred_* in predict, and the evaluated data set hands on truth with labels='truth'"
        )
    return fields


def point_truth(fields: Mapping[str, Any], rows: int, metric: str) -> PointTruth:
    """Truth of the whole scene where metainfo ``annotation`` holds it, else of the points that the network saw.

    A whole scene's truth has ``semantic`` (N,) and maybe ``instance`` (N,), and predictions find their points by the
    field ``point_index``: points that were dropped before the network then count as not predicted. Where the scene
    itself was thinned, ``original_index`` (N,) of the annotation names the scene's point that stands for each row.

    Args:
        fields: Fields of the sample.
        rows: Number of predicted rows.
        metric: For messages.

    Raises:
        SceneError: Truth is absent, or does not fit.
    """
    whole, index = fields.get('annotation'), fields.get('point_index')
    where = f'{metric}: scene {fields.get("scene_id", "")}'
    original = None
    if whole is not None and getattr(whole, 'semantic', None) is not None:
        semantic, instance = whole.semantic, getattr(whole, 'instance', None)
        original = getattr(whole, 'original_index', None)
        index = np.arange(rows) if index is None else index
    else:
        semantic = fields_of(fields, ['pts_semantic_mask'], metric)['pts_semantic_mask']
        instance, index = fields.get('pts_instance_mask'), np.arange(len(semantic))
    truth = PointTruth(
        semantic=_integers(semantic),
        instance=None if instance is None else _numbers(instance),
        index=_integers(index),
        original=None if original is None else _integers(original),
    )
    for name, values in (('instances', truth.instance), ('original_index rows', truth.original)):
        if values is not None and len(values) != len(truth.semantic):
            raise SceneError(f'{where}: {len(values)} true {name}, but {len(truth.semantic)} true classes')
    if len(truth.index) != rows or (rows and not 0 <= truth.index.min() <= truth.index.max() < truth.scene_points):
        raise SceneError(
            f'{where}: {rows} predicted rows do not fit {truth.scene_points} true ones; expected one row for each '
            'point, or point_index naming the point of each'
        )
    return truth


def _integers(values: Any) -> Int[np.ndarray, ' rows']:
    return numpy_of(values).astype(np.int64)


def _numbers(values: Any) -> Int[np.ndarray, ' rows']:
    """Instance numbers; unsigned ones of 64 bits, hashes say, are counted from 0 anew where they do not fit."""
    given = numpy_of(values)
    fits = given.dtype != np.uint64 or given.max(initial=0) <= np.iinfo(np.int64).max
    return given.astype(np.int64) if fits else np.unique(given, return_inverse=True)[1].reshape(-1)


def predicted_classes(probabilities: Float[np.ndarray, 'points classes']) -> Int[np.ndarray, ' points']:
    """Most likely class; -1 where the row is not finite or all zero."""
    if not probabilities.shape[1]:
        return np.full(len(probabilities), -1, dtype=np.int64)
    known = np.isfinite(probabilities).all(axis=1) & (probabilities > 0).any(axis=1)
    return np.where(known, np.nan_to_num(probabilities).argmax(axis=1), -1).astype(np.int64)


def semantic_rows(fields: Mapping[str, Any], metric: str) -> Int[np.ndarray, ' rows']:
    """Predicted classes: ``pred_pts_semantic_mask`` (n,), or the likeliest of ``pred_point_probs`` (n, C).

    Raises:
        SceneError: Neither is there.
    """
    if fields.get('pred_pts_semantic_mask') is not None:
        return numpy_of(fields['pred_pts_semantic_mask']).astype(np.int64)
    fields_of(fields, ['pred_point_probs'], metric)
    return predicted_classes(numpy_of(fields['pred_point_probs']))


def class_names(classes: Sequence[str] | None, meta: Mapping[str, Any] | None, metric: str) -> tuple[str, ...]:
    """Names of the class numbers.

    Raises:
        ValueError: Neither the metric nor the data set names them, or two are the same, letter case aside.
    """
    names = classes or (meta or {}).get('classes')
    if not names:
        raise ValueError(f'{metric}: no classes; pass classes=(...) or use a data set whose metainfo names them')
    return check_class_names(tuple(names), f'{metric}: classes')


def ignored_values(ignored: Sequence[int], meta: Mapping[str, Any] | None) -> tuple[int, ...]:
    """True values that do not count: those of the metric, and ``ignore_index`` of a data set of mmdetection3d."""
    further = (meta or {}).get('ignore_index')
    return (*ignored, int(further)) if isinstance(further, int | np.integer) else tuple(ignored)


def chosen_classes(
    chosen: Sequence[int | str] | None, names: Sequence[str], meta: Mapping[str, Any] | None, metric: str
) -> tuple[int, ...]:
    """Class numbers by number or name; None: the data set's ``thing_classes``, or all.

    Raises:
        ValueError: One of them is no class.
    """
    wanted = (meta or {}).get('thing_classes') if chosen is None else chosen
    if not wanted:
        return tuple(range(len(names)))
    numbers = [names.index(c) if isinstance(c, str) and c in names else c for c in wanted]
    for number in numbers:
        if not isinstance(number, int | np.integer) or not 0 <= number < len(names):
            raise ValueError(f'{metric}.instance_classes: {number!r} is none of {tuple(names)} nor their numbers')
    return tuple(int(number) for number in numbers)


def format_columns(head: Sequence[str], lines: Sequence[Sequence[str]]) -> str:
    """A table as text: the first column to the left, numbers to the right."""
    widths = [max(len(line[i]) for line in (head, *lines)) for i in range(len(head))]
    text = [
        '  '.join(
            cell.ljust(w) if i == 0 else cell.rjust(w) for i, (cell, w) in enumerate(zip(line, widths, strict=True))
        ).rstrip()
        for line in (head, *lines)
    ]
    return '\n'.join([text[0], '  '.join('-' * w for w in widths), *text[1:]])


def percent(value: float) -> str:
    """A share as percent, a dash for NaN."""
    return '-' if np.isnan(value) else f'{100 * value:.2f}'
