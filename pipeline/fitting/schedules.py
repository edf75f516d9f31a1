"""What conf/ says of how a reward map is fitted, as the library takes it."""

from omegaconf import DictConfig

from pipeline.spec.irl import Schedule
from pipeline.spec.jitter import Jitter


def reward_schedule(cfg: DictConfig, steps: int) -> Schedule:
    """conf/irl, and the variant's steps; ValueError for a value out of range."""
    s = cfg.irl
    jitter = Jitter(**{name: float(value) for name, value in s.jitter.items()})
    return Schedule(
        steps, float(s.rate), float(s.weight_decay), s.curve_every, s.scenes_per_step, s.copies,
        float(s.sparsity), s.across, jitter,
    )  # fmt: skip
