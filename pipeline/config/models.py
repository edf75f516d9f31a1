"""How models are fitted, and the variants of each kind."""

from typing import Annotated, Literal, get_args

from pydantic import Field

from pipeline.config.values import Chance, Count, Group, Several, Spread, expected

Rate = Annotated[float, Field(gt=0), expected("a number above 0")]
Weight = Annotated[float, Field(ge=0), expected("a weight from 0")]


class Schedule(Group):
    steps: Count
    rate: Rate
    weight_decay: Weight
    curve_every: Count


class VaeModel(Group):
    latent: Count
    channels: Annotated[list[Count], Field(min_length=3, max_length=3), expected("three whole numbers from 1")]
    hidden: Count


class Train(Schedule):
    engine: Annotated[Literal["auto", "simd", "cuda", "reference"], expected("one of auto, simd, cuda, reference")]
    model: VaeModel


class Jitter(Group):
    hue: Annotated[float, Field(ge=0), expected("an angle from 0 [rad]")]
    gain: Spread
    shift: Spread
    scene_gain: Spread
    other_table: Chance


class Irl(Group):
    rate: Rate
    weight_decay: Weight
    scenes_per_step: Count
    n_augmentations: Count
    sparsity: Weight
    across: bool
    curve_every: Count
    color_jitter: Jitter


class Vae(Group):
    stage: Annotated[Literal["train"], expected("train, which fits kind vae")]
    kind: Literal["vae"]
    alpha: Weight
    beta: Weight
    gamma: Annotated[float, Field(gt=0), expected("a weight above 0, or the classifier is never trained")]
    model: VaeModel


class RewardModel(Group):
    channels: Several
    dilated: Count
    gain: Annotated[float, Field(gt=0), expected("a factor above 0")]
    dropout: Annotated[float, Field(ge=0, lt=1), expected("a chance from 0, below 1")]
    lattice_side: Several
    symmetric: bool
    ceiling: bool


Objective = Literal["maxent", "ranked"]


class Reward(Group):
    stage: Annotated[Literal["irl"], expected("irl, which fits kind reward")]
    kind: Literal["reward"]
    objective: Annotated[Objective, expected(f"one of {', '.join(get_args(Objective))}")]
    steps: Count
    model: RewardModel


class ClearanceModel(Group):
    members: Count


class Clearance(Group):
    stage: Annotated[Literal["clearance"], expected("clearance, which fits kind clearance")]
    kind: Literal["clearance"]
    model: ClearanceModel


class Averaged(Schedule):
    members: Count


Variant = Annotated[Vae | Reward | Clearance, Field(discriminator="kind")]
