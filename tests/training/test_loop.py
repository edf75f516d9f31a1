"""A schedule's settings reach AdamW."""

import torch

from pipeline.training.loop import Schedule

VALUES = {"steps": 5, "rate": 0.1, "weight_decay": 0.02, "curve_every": 1}


def test_the_second_beta_reaches_the_optimiser_and_is_torch_s_own_unless_given():
    parameters = [torch.nn.Parameter(torch.zeros(1))]
    default = torch.optim.AdamW(parameters).defaults["betas"]
    assert Schedule.of(VALUES).optimiser(parameters)[0].defaults["betas"][1] == default[1]
    assert Schedule.of(VALUES | {"adam_beta2": 0.9}).optimiser(parameters)[0].defaults["betas"][1] == 0.9
