"""Who counts, and who hits whom, in the KITTI benchmark: the part of the evaluation that runs once a threshold.

All frames lie behind each other in flat arrays, so that one compiled loop serves a whole split.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from jaxtyping import Float, Int
from numba import njit

from rm3d_plugin.ops.boxes import rotated_iou_3d, rotated_iou_bev

MIN_HEIGHT = (40.0, 25.0, 25.0)  # px; easy, moderate, hard; METHOD 9
MAX_OCCLUSION = (0, 1, 2)
MAX_TRUNCATION = (0.15, 0.3, 0.5)
NEIGHBOURS = {'car': 'van', 'pedestrian': 'person_sitting'}  # ignored, neither hit nor miss
COUNTS, IGNORED, OTHER = 0, 1, -1  # roles of a truth or a detection in one task


class Found(Protocol):
    """What both sides of a frame carry."""

    @property
    def types(self) -> Sequence[str]: ...  # noqa: D102
    @property
    def bbox2d(self) -> Float[np.ndarray, 'rows 4']: ...  # noqa: D102
    @property
    def boxes3d(self) -> Float[np.ndarray, 'rows 7']: ...  # noqa: D102
    @property
    def alpha(self) -> Float[np.ndarray, ' rows'] | None: ...  # noqa: D102


class Truth(Found, Protocol):
    """A frame of truth."""

    @property
    def truncation(self) -> Float[np.ndarray, ' rows']: ...  # noqa: D102
    @property
    def occlusion(self) -> Int[np.ndarray, ' rows']: ...  # noqa: D102


class Detections(Found, Protocol):
    """A frame of detections."""

    @property
    def scores(self) -> Float[np.ndarray, ' rows']: ...  # noqa: D102


class Matches(NamedTuple):
    """Sums over all frames; without a threshold only ``hit_scores`` has a meaning."""

    true_positives: int
    false_positives: int
    similarity: float
    hit_scores: Float[np.ndarray, ' hits']


class Task(NamedTuple):
    """One class, difficulty and metric over all frames, flat; ``*_start`` (F + 1,) offsets of the frames.

    ``overlap`` holds each frame's (truths, detections) IoU row by row, ``forgiven`` the largest share of a detection
    that one DontCare area covers.
    """

    truth_start: Int[np.ndarray, ' frames_and_one']
    found_start: Int[np.ndarray, ' frames_and_one']
    overlap_start: Int[np.ndarray, ' frames_and_one']
    truth_role: Int[np.ndarray, ' truths']
    found_role: Int[np.ndarray, ' found']
    overlap: Float[np.ndarray, ' pairs']
    forgiven: Float[np.ndarray, ' found']
    scores: Float[np.ndarray, ' found']
    truth_alpha: Float[np.ndarray, ' truths']
    found_alpha: Float[np.ndarray, ' found']


@dataclass(frozen=True, eq=False)
class PackedFrames:
    """All frames of both sides, flat, with every overlap computed once."""

    truth_types: np.ndarray
    found_types: np.ndarray
    truth_height: Float[np.ndarray, ' truths']
    found_height: Float[np.ndarray, ' found']
    truncation: Float[np.ndarray, ' truths']
    occlusion: Int[np.ndarray, ' truths']
    overlaps: dict[str, Float[np.ndarray, ' _pairs']]
    task_base: Task

    def task(self, name: str, level: int, metric: str) -> Task:
        """Give every row its role for one class, difficulty (0 easy, 1 moderate, 2 hard) and metric."""
        wanted = name.lower()
        hard = (
            (self.occlusion > MAX_OCCLUSION[level])
            | (self.truncation > MAX_TRUNCATION[level])
            | (self.truth_height < MIN_HEIGHT[level])
        )
        same = self.truth_types == wanted
        near = self.truth_types == NEIGHBOURS.get(wanted, '')
        truth_role = np.where(same & ~hard, COUNTS, np.where(same | near, IGNORED, OTHER))
        # As in the official program a small detection is ignored before its class is asked for.
        small = self.found_height < MIN_HEIGHT[level]
        found_role = np.where(small, IGNORED, np.where(self.found_types == wanted, COUNTS, OTHER))
        base = self.task_base
        return base._replace(
            truth_role=truth_role.astype(np.int64),
            found_role=found_role.astype(np.int64),
            overlap=self.overlaps[metric],
            forgiven=base.forgiven if metric == 'bbox' else np.zeros_like(base.forgiven),
        )


def image_overlap(
    a: Float[np.ndarray, 'a 4'], b: Float[np.ndarray, 'b 4'], of_b: bool = False
) -> Float[np.ndarray, 'a b']:
    """IoU of image boxes (left, top, right, bottom), or the share of each ``b`` that ``a`` covers."""
    low = np.maximum(a[:, None, :2], b[None, :, :2])
    high = np.minimum(a[:, None, 2:], b[None, :, 2:])
    shared = np.maximum(high - low, 0).prod(axis=-1)
    size_a, size_b = (np.maximum(x[:, 2:] - x[:, :2], 0).prod(axis=-1) for x in (a, b))
    whole = np.broadcast_to(size_b[None], shared.shape) if of_b else size_a[:, None] + size_b[None] - shared
    return np.divide(shared, whole, out=np.zeros_like(shared), where=whole > 0)


def pack_frames(
    truths: Sequence[Truth], detections: Sequence[Detections], classes: Sequence[str] | None = None
) -> PackedFrames:
    """Check every frame and lay all of them behind each other.

    Args:
        truths: One entry a frame.
        detections: One entry a frame.
        classes: Truths of other classes (their neighbours apart) need no valid 3D box. None: all do, DontCare excepted.

    Raises:
        ValueError: The rows of a frame differ in number, a score is NaN, or a box is not valid.
    """
    parts: dict[str, list[np.ndarray]] = {k: [] for k in ('bbox', 'bev', '3d', 'forgiven')}
    read = None if classes is None else {c.lower() for c in classes} | {NEIGHBOURS.get(c.lower(), '') for c in classes}
    for number, (truth, found) in enumerate(zip(truths, detections, strict=True)):
        _check(number, truth, found)
        names = _lower(truth.types)
        boxes = np.array(truth.boxes3d, dtype=np.float64).reshape(-1, 7)
        skip = names == 'dontcare' if read is None else ~np.isin(names, list(read))
        boxes[skip] = 0.0
        found_boxes = np.asarray(found.boxes3d, dtype=np.float64).reshape(-1, 7)
        image = np.asarray(truth.bbox2d, dtype=np.float64).reshape(-1, 4)
        found_image = np.asarray(found.bbox2d, dtype=np.float64).reshape(-1, 4)
        covered = image_overlap(image[names == 'dontcare'], found_image, of_b=True)
        parts['bbox'].append(image_overlap(image, found_image).ravel())
        parts['bev'].append(rotated_iou_bev(boxes, found_boxes).ravel())
        parts['3d'].append(rotated_iou_3d(boxes, found_boxes).ravel())
        parts['forgiven'].append(covered.max(axis=0, initial=0.0))
    flat = {key: _join(arrays) for key, arrays in parts.items()}
    truth_image, found_image = (_join([f.bbox2d for f in side], 4) for side in (truths, detections))
    sizes = np.array([[len(t.types), len(d.types)] for t, d in zip(truths, detections, strict=True)]).reshape(-1, 2)
    base = Task(
        truth_start=_offsets(sizes[:, 0]),
        found_start=_offsets(sizes[:, 1]),
        overlap_start=_offsets(sizes[:, 0] * sizes[:, 1]),
        truth_role=np.zeros(0, dtype=np.int64),
        found_role=np.zeros(0, dtype=np.int64),
        overlap=np.zeros(0),
        forgiven=flat['forgiven'],
        scores=_join([d.scores for d in detections]),
        truth_alpha=_join([np.zeros(len(t.types)) if t.alpha is None else t.alpha for t in truths]),
        found_alpha=_join([np.zeros(len(d.types)) if d.alpha is None else d.alpha for d in detections]),
    )
    return PackedFrames(
        truth_types=_lower([name for t in truths for name in t.types]),
        found_types=_lower([name for d in detections for name in d.types]),
        truth_height=truth_image[:, 3] - truth_image[:, 1],
        found_height=np.abs(found_image[:, 3] - found_image[:, 1]),
        truncation=_join([t.truncation for t in truths]),
        occlusion=_join([t.occlusion for t in truths]).astype(np.int64),
        overlaps={key: flat[key] for key in ('bbox', 'bev', '3d')},
        task_base=base,
    )


def match_frames(task: Task, iou: float, threshold: float | None) -> Matches:
    """Assign detections to truths in every frame.

    Args:
        task: Rows with their roles.
        iou: A pair must overlap by more than this.
        threshold: Detections with a lower score do not take part. None: every detection does, and a truth takes the one
            with the highest score; this finds the scores at which to sample the curve.

    Returns:
        The sums over the frames.
    """
    final = threshold is not None
    tp, fp, similarity, hits, count = _match(*task, float(iou), final, -np.inf if threshold is None else threshold)
    return Matches(int(tp), int(fp), float(similarity), hits[:count])


@njit(cache=True)
def _match(
    truth_start: np.ndarray,
    found_start: np.ndarray,
    overlap_start: np.ndarray,
    truth_role: np.ndarray,
    found_role: np.ndarray,
    overlap: np.ndarray,
    forgiven: np.ndarray,
    scores: np.ndarray,
    truth_alpha: np.ndarray,
    found_alpha: np.ndarray,
    iou: float,
    final: bool,
    threshold: float,
) -> tuple[int, int, float, np.ndarray, int]:
    tp, fp, count = 0, 0, 0
    similarity = 0.0
    hits = np.empty(len(truth_role))
    taken = np.zeros(len(found_role), dtype=np.bool_)
    for frame in range(len(truth_start) - 1):
        first, end = found_start[frame], found_start[frame + 1]
        for i in range(truth_start[frame], truth_start[frame + 1]):
            if truth_role[i] == OTHER:
                continue
            row = overlap_start[frame] + (i - truth_start[frame]) * (end - first)
            best = -1
            for j in range(first, end):
                shared = overlap[row + j - first]
                if found_role[j] == OTHER or taken[j] or scores[j] < threshold or not shared > iou:
                    continue
                if best < 0:
                    best = j
                elif not final:
                    if scores[j] > scores[best]:
                        best = j
                elif found_role[j] == COUNTS:
                    # The greatest overlap wins; a detection that counts wins over an ignored one.
                    if found_role[best] == IGNORED or shared > overlap[row + best - first]:
                        best = j
            if best < 0:
                continue
            taken[best] = True
            if truth_role[i] == COUNTS and found_role[best] == COUNTS:
                tp += 1
                hits[count] = scores[best]
                count += 1
                similarity += 0.5 * (1.0 + np.cos(truth_alpha[i] - found_alpha[best]))
        for j in range(first, end):
            if found_role[j] == COUNTS and not taken[j] and scores[j] >= threshold and not forgiven[j] > iou:
                fp += 1
    return tp, fp, similarity, hits, count


def _check(number: int, truth: Truth, found: Detections) -> None:
    for side, frame, names in (
        ('truth', truth, ('truncation', 'occlusion', 'bbox2d', 'boxes3d', 'alpha')),
        ('detections', found, ('bbox2d', 'boxes3d', 'scores', 'alpha')),
    ):
        for name in names:
            values = getattr(frame, name)
            if values is not None and len(values) != len(frame.types):
                raise ValueError(f'frame {number}, {side}.{name}: expected {len(frame.types)} rows, got {len(values)}')
    if np.isnan(np.asarray(found.scores, dtype=np.float64)).any():
        raise ValueError(f'frame {number}, detections.scores: a score is NaN')


def _lower(names: Sequence[str]) -> np.ndarray:
    return np.array([name.lower() for name in names], dtype=str)


def _offsets(sizes: Int[np.ndarray, ' frames']) -> Int[np.ndarray, ' frames_and_one']:
    return np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)


def _join(arrays: Sequence[np.ndarray], columns: int | None = None) -> np.ndarray:
    shape = (-1,) if columns is None else (-1, columns)
    parts = [np.asarray(array, dtype=np.float64).reshape(shape) for array in arrays]
    empty = np.zeros(0) if columns is None else np.zeros((0, columns))
    return np.concatenate([empty, *parts])
