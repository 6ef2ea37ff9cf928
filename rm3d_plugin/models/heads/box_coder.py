"""Boxes as the numbers a proposal predicts, and back (VoteNet; METHOD 7)."""

import math
from typing import NamedTuple

import torch
from jaxtyping import Float, Int
from torch import Tensor

_THINNEST = 0.05  # m; no decoded box is thinner


class BoxPrediction(NamedTuple):
    """What the head says of every proposal.

    Attributes:
        objectness: (P, 2) logits of no object, object.
        centers: (P, 3) metres.
        heading_scores: (P, NH) logits of the heading bins.
        heading_residuals: (P, NH) offset from a bin's middle, in half bin widths.
        size_scores: (P, C) logits of the size templates, one a class.
        size_residuals: (P, C, 3) (size - template) / template.
        class_scores: (P, C) logits of the classes.
    """

    objectness: Float[Tensor, 'proposals 2']
    centers: Float[Tensor, 'proposals 3']
    heading_scores: Float[Tensor, 'proposals bins']
    heading_residuals: Float[Tensor, 'proposals bins']
    size_scores: Float[Tensor, 'proposals classes']
    size_residuals: Float[Tensor, 'proposals classes 3']
    class_scores: Float[Tensor, 'proposals classes']


class BoxCode(NamedTuple):
    """Boxes as regression targets: the fields of :class:`BoxPrediction` for known boxes.

    Attributes:
        centers: (K, 3) metres.
        heading_bins: (K,).
        heading_residuals: (K,) in half bin widths, in [-1, 1].
        size_residuals: (K, 3) relative to the template of the class.
        classes: (K,).
    """

    centers: Float[Tensor, 'boxes 3']
    heading_bins: Int[Tensor, ' boxes']
    heading_residuals: Float[Tensor, ' boxes']
    size_residuals: Float[Tensor, 'boxes 3']
    classes: Int[Tensor, ' boxes']


def prediction_width(heading_bins: int, num_classes: int) -> int:
    """Numbers a proposal: 2 objectness, 3 centre, 2 NH heading, 4 NS sizes (NS = C), C classes."""
    return 2 + 3 + 2 * heading_bins + 5 * num_classes


def split_prediction(
    raw: Float[Tensor, 'proposals width'], anchors: Float[Tensor, 'proposals 3'], heading_bins: int
) -> BoxPrediction:
    """Name the columns of a head's output; centres are relative to the proposals' anchors (metres)."""
    num_classes = (raw.shape[1] - 5 - 2 * heading_bins) // 5
    widths = [2, 3, heading_bins, heading_bins, num_classes, 3 * num_classes, num_classes]
    objectness, shift, bins, turn, sizes, stretch, classes = raw.split(widths, dim=1)
    return BoxPrediction(objectness, anchors + shift, bins, turn, sizes, stretch.reshape(-1, num_classes, 3), classes)


def encode_heading(yaw: Float[Tensor, ' boxes'], bins: int) -> tuple[Int[Tensor, ' boxes'], Float[Tensor, ' boxes']]:
    """Bin (bin b is centred on 2 pi b / bins) and residual in half bin widths; one bin = axis aligned, no heading."""
    if bins == 1:
        return torch.zeros_like(yaw, dtype=torch.int64), torch.zeros_like(yaw)
    width = 2.0 * math.pi / bins
    nearest = torch.round(yaw / width)
    return nearest.long().remainder(bins), (yaw - nearest * width) / (0.5 * width)


def decode_heading(
    bin_index: Int[Tensor, ' boxes'], residual: Float[Tensor, ' boxes'], bins: int
) -> Float[Tensor, ' boxes']:
    """Yaw in [-pi, pi) radians; 0 for axis-aligned boxes."""
    if bins == 1:
        return torch.zeros_like(residual)
    yaw = (bin_index + 0.5 * residual) * (2.0 * math.pi / bins)
    return (yaw + math.pi).remainder(2.0 * math.pi) - math.pi


def encode_boxes(
    boxes: Float[Tensor, 'boxes 7'],
    classes: Int[Tensor, ' boxes'],
    mean_sizes: Float[Tensor, 'classes 3'],
    heading_bins: int,
) -> BoxCode:
    """Regression targets of boxes; the size template is that of the class."""
    bins, residuals = encode_heading(boxes[:, 6], heading_bins)
    return BoxCode(boxes[:, :3], bins, residuals, boxes[:, 3:6] / mean_sizes[classes] - 1.0, classes)


def decode_boxes(prediction: BoxPrediction, mean_sizes: Float[Tensor, 'classes 3']) -> Float[Tensor, 'proposals 7']:
    """The box of each proposal: its likeliest heading bin and size template."""
    bins = prediction.heading_scores.shape[1]
    heading = prediction.heading_scores.argmax(dim=1)
    template = prediction.size_scores.argmax(dim=1)
    rows = torch.arange(len(heading), device=heading.device)
    yaw = decode_heading(heading, prediction.heading_residuals[rows, heading], bins)
    size = mean_sizes[template] * (1.0 + prediction.size_residuals[rows, template])
    return torch.cat([prediction.centers, size.clamp_min(_THINNEST), yaw[:, None]], dim=1)
