"""The loss of the paper, Eq. 1, term by term; each term states how it is reduced to a scalar.

This is its definition, which the autograd engine differentiates. Tests hold the gradient that was derived by hand for
the simd engine (training/vae/engines/simd.py `Stack`) against it.
"""

from typing import NamedTuple

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float
from torch import Tensor

from pipeline.models.base import LogOdds, Paths
from pipeline.models.vae.beta_vae import BetaVae
from pipeline.runtime.settings import Group, Size, Weight

Pictures, Codes = Float[Tensor, "scene 3 row column"], Float[Tensor, "scene latent"]
Labels = Bool[Tensor, "scene path"] | Float[Tensor, "scene path"]
Share = Float[Tensor, " path"] | None


class Weights(Group):
    """The weights alpha, beta and gamma of Eq. 1; with alpha or beta 0 the term is not computed."""

    alpha: Weight
    beta: Weight
    gamma: Size  # at 0 the classifier is never trained


class Terms(NamedTuple):
    """The three weighted terms of Eq. 1; 0 for a term with weight 0."""

    reconstruction: Tensor
    kl: Tensor
    classification: Tensor

    @property
    def total(self) -> Tensor:
        """Return the loss L of Eq. 1."""
        return self.reconstruction + self.kl + self.classification


def reconstruction(decoded: Pictures, images: Pictures) -> Float[Tensor, ""]:
    """Return -log p(I | z_image) of a Gaussian decoder up to scale: the mean squared error over all entries."""
    return F.mse_loss(decoded, images)


def kl(mean: Codes, log_variance: Codes) -> Float[Tensor, ""]:
    """Return KL(q(z_image | I) || N(0, 1)) [nat]: summed over latent dimensions, averaged over scenes."""
    return 0.5 * (mean.square() + log_variance.exp() - log_variance - 1).sum(-1).mean()


def classification(logits: LogOdds, valid: Labels, share: Share = None) -> Float[Tensor, ""]:
    """Return the binary cross-entropy of validity [nat]: mean over paths, or weighted by their `share`."""
    if share is None:
        return F.binary_cross_entropy_with_logits(logits, valid.to(logits.dtype))
    each = F.binary_cross_entropy_with_logits(logits, valid.to(logits.dtype), reduction="none")
    return (each * share).sum(1).mean()


def equation_1(
    model: BetaVae, images: Pictures, z_theta: Paths, valid: Labels, weights: Weights, noise: Codes, share: Share = None
) -> Terms:
    """Return the terms of Eq. 1 on labelled paths; each scene is encoded once for all its paths.

    With beta > 0 decoder and classifier receive a sample, mean + noise * deviation. With beta = 0 no prior keeps the
    deviation from collapsing, so they receive the mean, and `noise` is unused.
    """
    features = model.encode(images)
    z_image = mean = model.mean(features)  # (scene, latent)
    divergence = error = mean.new_zeros(())
    if weights.beta:
        log_variance = model.log_variance(features)
        z_image = mean + noise * torch.exp(0.5 * log_variance)
        divergence = weights.beta * kl(mean, log_variance)
    if weights.alpha:
        error = weights.alpha * reconstruction(model.decode(z_image), images)
    return Terms(error, divergence, weights.gamma * classification(model.logit(z_image, z_theta), valid, share))
