"""What conf/ says of how models are fitted, as the library takes it; ValueError for a value out of range."""

from omegaconf import DictConfig

from pipeline.spec import irl, training
from pipeline.spec.jitter import Jitter


def schedule(group: DictConfig) -> training.Schedule:
    """conf/train or conf/path."""
    return training.Schedule(group.steps, float(group.rate), float(group.weight_decay), group.curve_every)


def reward_schedule(cfg: DictConfig, steps: int) -> irl.Schedule:
    """conf/irl, and the variant's steps."""
    s = cfg.irl
    jitter = Jitter(**{name: float(value) for name, value in s.jitter.items()})
    return irl.Schedule(
        steps, float(s.rate), float(s.weight_decay), s.curve_every, s.scenes_per_step, s.copies,
        float(s.sparsity), s.across, jitter,
    )  # fmt: skip
