"""Average precision as the KITTI object benchmark counts it (METHOD 9): 2D, orientation, bird's eye and 3D.

What the official program does, and so do we: ground truth with a 2D height *below* the limit is ignored (ports use "not
above"), and so are detections; a DontCare area forgives detections in 2D only; Van (for Car) and Person_sitting (for
Pedestrian) are ignored, neither hit nor miss; an ignored truth may take a detection, which then counts as nothing.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from rm3d_plugin.evaluation.functional.kitti_matching import PackedFrames, match_frames, pack_frames

Difficulty = Literal['easy', 'moderate', 'hard']
Metric = Literal['bbox', 'aos', 'bev', '3d']
Sampling = Literal['auto', 'official', 'interpolated']

DIFFICULTIES: tuple[Difficulty, ...] = ('easy', 'moderate', 'hard')
METRICS: tuple[Metric, ...] = ('bbox', 'aos', 'bev', '3d')
OFFICIAL_IOU: Mapping[str, float] = {'Car': 0.7, 'Pedestrian': 0.5, 'Cyclist': 0.5}
LOOSE_IOU: Mapping[str, float] = {'Car': 0.5, 'Pedestrian': 0.25, 'Cyclist': 0.25}
POSITIONS = 41  # recall 0, 1/40, ..., 1


@dataclass(frozen=True, eq=False)
class KittiTruth:
    """What is to be found in one frame.

    Attributes:
        types: Class name of each object; letter case does not matter. 'DontCare' marks an area of the image.
        truncation: (G,) share outside the image.
        occlusion: (G,) 0 visible to 3 unknown.
        bbox2d: (G, 4) left, top, right, bottom in pixels.
        boxes3d: (G, 7) rows (x, y, z, dx, dy, dz, yaw) in any frame that the detections share; rows of classes that are
            not evaluated, DontCare among them, are not read.
        alpha: (G,) observation angle in radians, or None: then no orientation similarity.
    """

    types: Sequence[str]
    truncation: Float[np.ndarray, ' truths']
    occlusion: Int[np.ndarray, ' truths']
    bbox2d: Float[np.ndarray, 'truths 4']
    boxes3d: Float[np.ndarray, 'truths 7']
    alpha: Float[np.ndarray, ' truths'] | None = None


@dataclass(frozen=True, eq=False)
class KittiDetections:
    """What was found in one frame; fields as in :class:`KittiTruth`, ``scores`` (D,) higher is surer."""

    types: Sequence[str]
    bbox2d: Float[np.ndarray, 'found 4']
    boxes3d: Float[np.ndarray, 'found 7']
    scores: Float[np.ndarray, ' found']
    alpha: Float[np.ndarray, ' found'] | None = None


class ApEntry(NamedTuple):
    """One cell of the table.

    Attributes:
        class_name: Class.
        metric: 'bbox' (2D), 'aos' (2D weighted by orientation), 'bev' or '3d'.
        difficulty: 'easy', 'moderate' or 'hard'.
        iou: Overlap above which a detection counts as a hit.
        r40: Mean precision in percent over recall 1/40 ... 1; NaN where there is no truth.
        r11: Mean precision in percent over recall 0, 0.1 ... 1; NaN where there is no truth.
        num_truth: Truths that count (the rest is ignored).
        precision: (41,) precision in [0, 1] at recall 0, 1/40 ... 1, made monotone.
        interpolated: Whether the curve was interpolated, not sampled as the official program does.
    """

    class_name: str
    metric: Metric
    difficulty: Difficulty
    iou: float
    r40: float
    r11: float
    num_truth: int
    precision: Float[np.ndarray, '41']
    interpolated: bool = False


@dataclass(frozen=True)
class KittiAp:
    """Every cell of the table, in the order of classes, metrics, difficulties."""

    entries: tuple[ApEntry, ...]

    def cell(self, class_name: str, metric: Metric, difficulty: Difficulty) -> ApEntry:
        """The cell of that name.

        Raises:
            KeyError: There is none.
        """
        for entry in self.entries:
            if (entry.class_name, entry.metric, entry.difficulty) == (class_name, metric, difficulty):
                return entry
        raise KeyError(f'no cell {class_name}/{metric}/{difficulty} in this table')

    def mean(self, metric: Metric, difficulty: Difficulty, recall: Literal['r40', 'r11'] = 'r40') -> float:
        """Mean over the classes that have truth, percent; NaN where none has."""
        cells = self.counted(metric, difficulty)
        return float(np.mean([getattr(e, recall) for e in cells])) if cells else np.nan

    def counted(self, metric: Metric, difficulty: Difficulty) -> list[ApEntry]:
        """Cells of the classes that have truth."""
        return [e for e in self.entries if e.metric == metric and e.difficulty == difficulty and e.num_truth > 0]


def recall_thresholds(hits: Float[np.ndarray, ' hits'], num_truth: int) -> Float[np.ndarray, ' thresholds']:
    """Scores at which the official program samples the curve: those whose recall is nearest to 0, 1/40, ..., 1.

    Args:
        hits: Scores of the detections that hit a truth.
        num_truth: Truths that count.

    Returns:
        At most 41 scores, falling.
    """
    ordered = np.sort(hits)[::-1]
    chosen = []
    current = 0.0
    for i, score in enumerate(ordered):
        last = i == len(ordered) - 1
        left = (i + 1) / num_truth
        right = left if last else (i + 2) / num_truth
        if right - current < current - left and not last:
            continue
        chosen.append(score)
        current += 1 / (POSITIONS - 1)
    return np.array(chosen[:POSITIONS], dtype=np.float64)


def kitti_ap(
    ground_truths: Sequence[KittiTruth],
    detections: Sequence[KittiDetections],
    classes: Sequence[str] = ('Car', 'Pedestrian', 'Cyclist'),
    iou_thresholds: Mapping[str, float] = OFFICIAL_IOU,
    metrics: Sequence[Metric] = METRICS,
    sampling: Sampling = 'official',
) -> KittiAp:
    """Average precision of each class, metric and difficulty.

    Args:
        ground_truths: One entry a frame.
        detections: One entry a frame, in the same order.
        classes: Classes to evaluate.
        iou_thresholds: Overlap above which a detection hits, bird's eye and 3D. 2D uses the official thresholds for the
            official classes and these for others.
        metrics: Which to compute; 'aos' needs ``alpha`` on both sides and is left out without.
        sampling: 'official' takes the i-th sampled score for recall i/40 whatever recall it has, so fewer than 41
            truths cannot reach 100 (ten truths found without error: 22.5). 'interpolated' takes the best precision at
            that recall or more, exact for any number. 'auto': official from 41 truths on, interpolated below.

    Raises:
        ValueError: The numbers of frames or rows differ, a class has no threshold, a score is NaN, or an option is
            unknown.
    """
    if sampling not in ('auto', 'official', 'interpolated'):
        raise ValueError(f"sampling: expected 'auto', 'official' or 'interpolated', got {sampling!r}")
    unknown = [m for m in metrics if m not in METRICS]
    if unknown:
        raise ValueError(f'metrics: expected some of {", ".join(METRICS)}, got {unknown[0]!r}')
    missing = [name for name in classes if name not in iou_thresholds]
    if missing:
        raise ValueError(f'iou_thresholds: no value for class {missing[0]!r}; got {dict(iou_thresholds)}')
    if len(ground_truths) != len(detections):
        raise ValueError(f'kitti_ap: {len(ground_truths)} frames of truth, {len(detections)} of detections')
    has_alpha = all(t.alpha is not None and d.alpha is not None for t, d in zip(ground_truths, detections, strict=True))
    wanted = [m for m in METRICS if m in metrics and (m != 'aos' or has_alpha)]
    frames = pack_frames(ground_truths, detections, classes)
    entries: list[ApEntry] = []
    for name in classes:
        for metric in wanted:
            flat = metric in ('bbox', 'aos')
            iou = OFFICIAL_IOU.get(name, iou_thresholds[name]) if flat else iou_thresholds[name]
            entries += [_cell(frames, name, metric, difficulty, iou, sampling) for difficulty in DIFFICULTIES]
    return KittiAp(tuple(entries))


def _cell(
    frames: PackedFrames, name: str, metric: Metric, difficulty: Difficulty, iou: float, sampling: Sampling
) -> ApEntry:
    task = frames.task(name, DIFFICULTIES.index(difficulty), 'bbox' if metric == 'aos' else metric)
    count = int((task.truth_role == 0).sum())
    if count == 0:
        return ApEntry(name, metric, difficulty, iou, np.nan, np.nan, 0, np.zeros(POSITIONS))
    hits = match_frames(task, iou, None).hit_scores
    official = sampling == 'official' or (sampling == 'auto' and count >= POSITIONS)
    thresholds = recall_thresholds(hits, count) if official else np.unique(hits)[::-1]
    recall = np.zeros(len(thresholds))
    value = np.zeros(len(thresholds))
    for i, threshold in enumerate(thresholds):
        found = match_frames(task, iou, float(threshold))
        top = found.similarity if metric == 'aos' else found.true_positives
        total = found.true_positives + found.false_positives
        value[i] = top / total if total else 0.0
        recall[i] = found.true_positives / count
    precision = np.zeros(POSITIONS)
    if official:
        precision[: len(value)] = value
    else:
        for k in range(POSITIONS):
            precision[k] = value[recall >= k / (POSITIONS - 1) - 1e-9].max(initial=0.0)
    precision = np.maximum.accumulate(precision[::-1])[::-1]
    r40, r11 = 100 * float(precision[1:].mean()), 100 * float(precision[::4].mean())
    return ApEntry(name, metric, difficulty, iou, r40, r11, count, precision, not official)
