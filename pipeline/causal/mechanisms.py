"""Mechanisms of the structural causal model: the renderer, a seed's fitted models, and the world's own rules.

Units are scenes. Each has its paths on a second axis: Z_theta is (scene, path, 2) [m], V is (scene, path).
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
import torch
from jaxtyping import Float, Int
from numpy import ndarray as Array

from pipeline.causal.scm import SCM, Values, specification_scm
from pipeline.models.base import SCENES_PER_BATCH, Images, ValidityModel, to_tensor
from pipeline.world.layout import Layouts
from pipeline.world.render import Palette, render_scenes
from pipeline.world.rules import Margins, valid

Render = Callable[[Int[Array, " scene"], Layouts, Array], Images]  # arguments: render seeds, items, names of table tops


def renderer(palette: Palette) -> Render:
    """Return the mechanism of I: the image of items and table top, with light and noise from the render seed."""
    return lambda seeds, items, table_tops: render_scenes(items, table_tops.tolist(), seeds.tolist(), palette)


def recorded_noise(layouts: Layouts, appearance: pd.DataFrame, z_theta: Array) -> Values:
    """Return the noises on record of scenes and paths [m]: items, table top and render seed; 0 for S and Z_I."""
    top, render_seed = (appearance[column].to_numpy() for column in ("texture", "render_seed"))
    zero = np.zeros(len(layouts), dtype=int)
    return {"S": zero, "O": layouts, "T": top, "I": render_seed, "Z_theta": z_theta, "Z_I": zero.astype(float)}


def model_scm(models: Mapping[str, ValidityModel], render: Render | Any = None) -> SCM:
    """Return the structural causal model with these users' fitted models as the mechanisms of Z_I and V.

    Z_I holds each user's percepts, in batches of SCENES_PER_BATCH scenes. render: None where each question sets I.
    """

    @torch.no_grad()
    def encode(image: Images) -> dict[str, list]:
        batches = [to_tensor(image[i : i + SCENES_PER_BATCH]) for i in range(0, len(image), SCENES_PER_BATCH)]
        return {user: [model.eval().perceive(batch) for batch in batches] for user, model in models.items()}

    @torch.no_grad()
    def probability(user: str, z_image: Mapping[str, list], z_theta: Array) -> Array:
        z = torch.as_tensor(np.asarray(z_theta, dtype=np.float32)).split(SCENES_PER_BATCH)
        logits = [models[user].eval().logit(*batch) for batch in zip(z_image[user], z, strict=True)]
        return torch.sigmoid(torch.cat(logits)).numpy()

    return specification_scm(list(models), render, encode, _by_user(probability))


def true_scm(users: Mapping[str, Margins]) -> SCM:
    """Return the simulated world as a structural causal model: Z_I is the items, and V follows from the margins [m]."""

    def probability(user: str, items: Layouts, z_theta: Array) -> Array:
        return valid(items, z_theta, users[user]).astype(np.float64)

    return specification_scm(list(users), lambda _, items, table_top: items, lambda items: items, _by_user(probability))


def _by_user(probability: Callable[[str, Any, Array], Array]) -> Callable[..., Float[Array, "scene path"]]:
    """Return C_s as a function of S, given one user's probabilities (scene, path); units may have different users."""

    def classify(s: Array, z_image: Any, z_theta: Array) -> Array:
        users = np.unique(s)
        asked = [np.asarray(s == user)[:, None] for user in users]
        return np.select(asked, [probability(str(user), z_image, z_theta) for user in users])

    return classify


def expected_validities(
    scm: SCM, noise: Values, users: Sequence[str], changes: Sequence[Values]
) -> Float[Array, "change user scene"]:
    """Return E[V | do(Z_I := Z_I under do(change)), S = s] of each user in each scene, over the scene's paths.

    This is the paper's estimand: `change` sets O, T or I, and {} leaves the scene unchanged. All changes share the
    noises; N_V is averaged in closed form, so E[V] over paths is the mean of P(valid). S has no parent, and V is its
    only child. The row of user s' without a change is therefore also E[V | do(S := s'), S = s].
    """
    expected = []
    for change in changes:
        z_image = scm.do(**change).entail(noise, "Z_I")["Z_I"]
        answers = [scm.do(Z_I=z_image, S=user).expectation("V", noise) for user in users]
        expected.append([np.mean(p, axis=-1, dtype=np.float64) for p in answers])
    return np.array(expected)
