"""Truncated cross-entropy, and features as a mixture of von Mises-Fisher distributions (DGNet, NeurIPS 2024)."""

import math
from typing import NamedTuple

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float
from torch import Tensor

KAPPA = 10.0
STEPS = 10  # of expectation maximisation


class Mixture(NamedTuple):
    """Components on the unit sphere, one a class.

    Attributes:
        means: (C, F) unit vectors.
        log_shares: (C,) logarithm of each component's share of the points; -inf for a class that is not there.
    """

    means: Float[Tensor, 'classes channels']
    log_shares: Float[Tensor, ' classes']

    def log_posterior(
        self, features: Float[Tensor, 'points channels'], kappa: float
    ) -> Float[Tensor, 'points classes']:
        """Logarithm of how likely each unit vector is of each class; components are equally narrow."""
        return (kappa * features @ self.means.T + self.log_shares).log_softmax(dim=1)


def fit_mixture(
    features: Float[Tensor, 'points channels'],
    start: Float[Tensor, 'classes channels'],
    present: Bool[Tensor, ' classes'],
    kappa: float = KAPPA,
    steps: int = STEPS,
) -> Mixture:
    """Expectation maximisation with one fixed ``kappa``, without gradients.

    Args:
        features: Unit vectors.
        start: Unit vectors, of labelled points.
        present: Classes that take part; at least one.
        kappa: Larger: narrower components.
        steps: Of expectation and maximisation.
    """
    shares = present.to(features) / present.sum()
    mixture = Mixture(start, shares.log())
    with torch.no_grad():
        for _ in range(steps):
            posterior = mixture.log_posterior(features, kappa).exp()
            means = F.normalize(posterior.T @ features, dim=1)
            kept = torch.where(present[:, None], means, start)
            mixture = Mixture(kept, posterior.mean(dim=0).clamp_min(1e-12).log().masked_fill(~present, -math.inf))
    return mixture


class MixtureLosses(NamedTuple):
    """Scalars.

    Attributes:
        likelihood: Cross-entropy of the posterior with itself over ln C: points draw near to their components.
        agreement: Cross-entropy of the posterior with what the network says.
        similarity: Mean cosine between the means of different classes.
    """

    likelihood: Float[Tensor, '']
    agreement: Float[Tensor, '']
    similarity: Float[Tensor, '']


def mixture_losses(
    features: Float[Tensor, 'points channels'],
    logits: Float[Tensor, 'points classes'],
    mixture: Mixture,
    kappa: float = KAPPA,
) -> MixtureLosses:
    """What a fitted mixture has to say to the features and the logits that it was fitted to.

    The posterior is a target without gradient. In ``similarity`` the means are those of one more maximisation, so that
    features move apart.

    Args:
        features: Unit vectors, at least one.
        logits: Of the same points.
        mixture: From :func:`fit_mixture`.
        kappa: The same.
    """
    present = mixture.log_shares > -math.inf
    log_posterior = mixture.log_posterior(features, kappa)[:, present]
    target = log_posterior.detach().exp()
    likelihood = -(target * log_posterior).sum(dim=1).mean() / math.log(max(len(present), 2))
    agreement = -(target * logits.log_softmax(dim=1)[:, present]).sum(dim=1).mean()
    means = F.normalize(target.T @ features, dim=1)
    count = len(means)
    cosines = (means @ means.T).fill_diagonal_(0.0) if count > 1 else means.new_zeros(1, 1)
    return MixtureLosses(likelihood, agreement, cosines.sum() / max(count * (count - 1), 1))


def truncated(each: Float[Tensor, ' points'], limit: float) -> Float[Tensor, ' points']:
    """Cross-entropy that stops where the right class has a probability of ``limit``: no gradient from there on.

    >>> truncated(-torch.tensor([0.5, 0.9]).log(), 0.8).exp().reciprocal().tolist()
    [0.5, 0.800000011920929]
    """
    return each.clamp_min(-math.log(limit))
