"""Cross-entropy that sure points weigh little in (AADNet, AAAI 2025)."""

from jaxtyping import Float, Int
from torch import Tensor

from rm3d_plugin.models.consistency import training_progress
from rm3d_plugin.models.losses import ReducedLoss, Reduction
from rm3d_plugin.models.losses.point_cross_entropy import weighted_cross_entropy
from rm3d_plugin.registry import MODELS


def entropy(logits: Float[Tensor, 'points classes']) -> Float[Tensor, ' points']:
    """Of the softmax, natural logarithm, in [0, ln C]."""
    logs = logits.log_softmax(dim=1)
    return -(logs.exp() * logs).sum(dim=1)


def smoothed(
    cross_entropy: Float[Tensor, ' points'], logits: Float[Tensor, 'points classes'], smoothing: float
) -> Float[Tensor, ' points']:
    """Cross-entropy with a target of which a share lies evenly on all classes.

    Args:
        cross_entropy: With the plain target.
        logits: Of the same points.
        smoothing: That share.
    """
    return (1.0 - smoothing) * cross_entropy - smoothing * logits.log_softmax(dim=1).mean(dim=1)


@MODELS.register_module()
class EntropyWeightedLoss(ReducedLoss):
    """Label-smoothed cross-entropy times the detached entropy of what the network says.

    From ``start`` on, spans of training alternate: cross-entropy plus ``entropy_weight`` times the entropy, then the
    product again. Called as ``PointCrossEntropyLoss`` is.

    Args:
        smoothing: Share of the target that lies evenly on all classes.
        start: Share of training after which spans alternate.
        span: Length of each, a share of training.
        entropy_weight: Of the entropy where it is a term of its own.
        loss_weight: Factor of the loss.
        reduction: 'mean' over the weights, 'sum' or 'none' of the points.
    """

    def __init__(
        self,
        smoothing: float = 0.2,
        start: float = 0.5,
        span: float = 0.05,  # 5 of 100 epochs
        entropy_weight: float = 0.01,
        loss_weight: float = 1.0,
        reduction: Reduction = 'mean',
    ) -> None:
        super().__init__(loss_weight, reduction)
        self.smoothing, self.start, self.span, self.entropy_weight = smoothing, start, span, entropy_weight

    def forward(
        self,
        logits: Float[Tensor, 'points classes'],
        labels: Int[Tensor, ' points'],
        class_weights: Float[Tensor, ' classes'] | None = None,
        point_weights: Float[Tensor, ' points'] | None = None,
    ) -> Float[Tensor, '...']:
        """Loss over the labelled points; 0 where there are none.

        Args:
            logits: Raw class scores.
            labels: Class numbers; -1 = unlabelled.
            class_weights: Weight of each class; 1 when not given.
            point_weights: Further factor of each point; 1 when not given.
        """
        plain = weighted_cross_entropy(logits, labels)
        weight = weighted_cross_entropy(logits, labels, class_weights, point_weights=point_weights).weight
        each = smoothed(plain.loss, logits, self.smoothing)
        unsure = entropy(logits)
        each = each + self.entropy_weight * unsure if self.adds_entropy() else each * unsure.detach()
        return self.weighted(weight * each, None, weight.sum().clamp_min(1e-6))

    def adds_entropy(self) -> bool:
        """Whether the entropy is a term now, not a factor."""
        done = training_progress()
        return done >= self.start and int((done - self.start) / self.span + 1e-9) % 2 == 0
