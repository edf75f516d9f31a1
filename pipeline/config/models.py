"""Parameters of training, and of the variants of each kind of model."""

from typing import Annotated, Literal

from pydantic import Field

from pipeline.runtime.settings import Chance, Count, Demonstrations, Group, Several, Size, Spread, Weight, expected


class Schedule(Group):
    """Steps of AdamW with a one-cycle learning rate."""

    steps: Count
    rate: Size
    weight_decay: Weight
    curve_every: Count


class VaeModel(Group):
    latent: Count
    channels: Annotated[list[Count], Field(min_length=3, max_length=3), expected("three whole numbers from 1")]
    hidden: Count


class Train(Schedule):
    adam_beta2: Annotated[float, Field(ge=0, lt=1), expected("a number from 0, below 1")]
    engine: Literal["auto", "simd", "cuda", "reference"]
    model: VaeModel


class Jitter(Group):
    """Augmentation of the reward map's training scenes."""

    hue: Annotated[float, Field(ge=0), expected("an angle from 0 [rad]")]
    gain: Spread
    shift: Spread
    scene_gain: Spread
    other_table: Chance


class Irl(Group):
    rate: Size
    weight_decay: Weight
    scenes_per_step: Count
    n_augmentations: Count
    curve_every: Count
    color_jitter: Jitter


class Fitted(Group):
    """Check the setting of all variants: numbers of demonstrations to fit at besides main_n_demos; null: all."""

    n_demos: Annotated[list[Demonstrations], Field(min_length=1)] | None
    compared: bool


class Vae(Fitted):
    """A variant of the paper's model: the weights of Eq. 1."""

    stage: Annotated[Literal["train"], expected("train, which fits kind vae")]
    kind: Literal["vae"]
    alpha: Weight
    beta: Weight
    gamma: Annotated[float, Field(gt=0), expected("a weight above 0, or the classifier is never trained")]
    model: VaeModel


class RewardModel(Group):
    channels: Several
    dilated: Count
    gain: Size
    dropout: Annotated[float, Field(ge=0, lt=1), expected("a probability from 0, below 1")]
    lattice_side: Several
    symmetric: bool
    ceiling: bool


class Reward(Fitted):
    """A variant of the inverse reinforcement learning baseline."""

    stage: Annotated[Literal["irl"], expected("irl, which fits kind reward")]
    kind: Literal["reward"]
    objective: Literal["maxent", "ranked"]
    steps: Count
    model: RewardModel


class ClearanceModel(Group):
    members: Count


class Clearance(Fitted):
    """A variant of the clearance model."""

    stage: Annotated[Literal["clearance"], expected("clearance, which fits kind clearance")]
    kind: Literal["clearance"]
    model: ClearanceModel


Variant = Annotated[Vae | Reward | Clearance, Field(discriminator="kind")]
