"""The mechanisms that run: the renderer, the models of a seed, and the world's own rule.

Units are scenes. Each carries all its paths along a second axis: Z_theta is (scene, path, 2) [m], V (scene, path).
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import torch
from jaxtyping import Float, Int, UInt8
from numpy import ndarray as Array

from pipeline.causal.interventions import expected_validity
from pipeline.causal.scm import SCM, Values, specification_scm
from pipeline.models.base import SCENES_PER_BATCH, ValidityModel, to_tensor
from pipeline.world.layout import Layouts
from pipeline.world.render import Palette, render_scenes
from pipeline.world.rules import Margins, valid

Image = UInt8[Array, "scene 100 100 3"]
Render = Callable[[Int[Array, " scene"], Layouts, Array], Image]  # render seeds, items, names of table tops


def renderer(palette: Palette) -> Render:
    """Return the mechanism of I: the image of the items on the table top, light and noise by the render seed."""

    def render(render_seeds: Int[Array, " scene"], items: Layouts, table_tops: Array) -> Image:
        return render_scenes(items, table_tops.tolist(), render_seeds.tolist(), palette)

    return render


def model_scm(models: Mapping[str, ValidityModel], render: Render) -> SCM:
    """Return the model with these users' fitted models as the mechanisms of Z_I and V.

    Z_I holds, for each user, the percepts of SCENES_PER_BATCH scenes at a time.
    """

    @torch.no_grad()
    def encode(image: Image) -> dict[str, list]:
        batches = [to_tensor(image[i : i + SCENES_PER_BATCH]) for i in range(0, len(image), SCENES_PER_BATCH)]
        return {user: [model.eval().perceive(batch) for batch in batches] for user, model in models.items()}

    @torch.no_grad()
    def probability(user: str, z_image: Mapping[str, list], z_theta: Array) -> Array:
        z = torch.as_tensor(np.asarray(z_theta, dtype=np.float32)).split(SCENES_PER_BATCH)
        logits = [models[user].eval().logit(*batch) for batch in zip(z_image[user], z, strict=True)]
        return torch.sigmoid(torch.cat(logits)).numpy()

    return specification_scm(list(models), render, encode, by_user(probability))


def true_scm(users: Mapping[str, Margins]) -> SCM:
    """Return the simulated world: users see the items themselves, and V is the rule of their margins [m]."""

    def probability(user: str, items: Layouts, z_theta: Array) -> Array:
        return valid(items, z_theta, users[user]).astype(np.float64)

    return specification_scm(list(users), lambda _, items, table_top: items, lambda items: items, by_user(probability))


def by_user(probability: Callable[[str, Any, Array], Array]) -> Callable[..., Float[Array, "scene path"]]:
    """Return C_s from one user's probabilities, (scene, path), for units that need not share their user."""

    def classify(s: Array, z_image: Any, z_theta: Array) -> Array:
        users = np.unique(s)
        return np.select(
            [np.asarray(s == user)[:, None] for user in users],
            [probability(str(user), z_image, z_theta) for user in users],
        )

    return classify


def expected_validities(
    scm: SCM, noise: Values, users: Sequence[str], changes: Sequence[Values]
) -> Float[Array, "change user scene"]:
    """Return E[V | do(Z_I := Z_I under do(change)), S = s] of every user in every scene, over its paths.

    The estimand of the paper: `change` sets O, T or I, and {} leaves the scene as it is. Noises are shared, and N_V is
    averaged in closed form. Since S has no parent and V alone for a child, the row of user s' and no change is also
    E[V | do(S := s'), S = s].
    """
    expected = []
    for change in changes:
        z_image = scm.do(**change).entail(noise, "Z_I")["Z_I"]
        answers = [scm.do(Z_I=z_image, S=user).expectation("V", noise) for user in users]
        expected.append([expected_validity(p) for p in answers])
    return np.array(expected)
