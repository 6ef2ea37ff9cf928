"""Descriptors learn the classes of labelled scans; several data sets teach one network, each by its own classes."""

from collections.abc import Sequence
from typing import Any

import torch
from torch import Tensor, nn
from torch.nn.functional import cross_entropy

from rm3d_plugin.models.batch import Batch
from rm3d_plugin.models.losses.loss_term import LossTerm
from rm3d_plugin.models.losses.point_cross_entropy import class_weights
from rm3d_plugin.registry import MODELS

SCALE = 16.0  # of unit vectors, so that a linear layer can be sure of a class


@MODELS.register_module()
class SiteClasses(LossTerm):
    """``loss_classes``: a linear layer on the descriptors tells the class of each site; and ``right``, logged only.

    The layer is dropped afterwards, since other scans have other classes. A site is compared with the classes of its
    own data set alone: no other would call its class by that name.

    Args:
        channels: Values of a descriptor.
        classes: How many each data set has, in the order of their blocks of numbers.
        power: Rare classes weigh more, see :func:`~rm3d_plugin.models.losses.class_weights`; counted in each batch.
        smoothing: Share of a label that is spread over all classes.
    """

    needs = ('features', 'classes')

    def __init__(self, channels: int, classes: Sequence[int], power: float = 0.5, smoothing: float = 0.05) -> None:
        super().__init__()
        self.blocks = tuple(classes)
        self.layer = nn.Linear(channels, sum(classes))
        self.power, self.smoothing = power, smoothing

    def forward(self, batch: Batch, outputs: Any, labels: Any) -> dict[str, Tensor]:
        """The mean over the sites whose class is known; 0 where none is.

        Raises:
            ValueError: A class is of no block.
        """
        known = labels.classes >= 0
        if known.any() and int(labels.classes.max()) >= sum(self.blocks):
            raise ValueError(
                f'SiteClasses: got class {int(labels.classes.max())}, expected fewer than the {sum(self.blocks)} of '
                'site_classes; first_class and site_classes must agree with the data sets'
            )
        logits, classes = self.layer(SCALE * outputs.features[known]), labels.classes[known]
        losses, right, first = [0.0 * logits.sum()], logits.new_zeros(()), 0
        for count in self.blocks:
            own = (classes >= first) & (classes < first + count)
            if own.any():
                said, target = logits[own, first : first + count], classes[own] - first
                weight = class_weights(torch.bincount(target, minlength=count), self.power).to(said)
                mean = cross_entropy(said, target, weight, label_smoothing=self.smoothing)
                losses.append(mean * own.sum())
                right = right + (said.argmax(1) == target).sum()
            first += count
        total = max(len(classes), 1)
        return {'loss_classes': torch.stack(losses).sum() / total, 'right': right / total}
