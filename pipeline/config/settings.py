"""All parameters together, and what those of one group must be to those of others."""

from typing import Annotated, Any

from pydantic import AfterValidator, Field, model_validator

from pipeline.config.models import Irl, Schedule, Train, Variant
from pipeline.config.questions import Question
from pipeline.config.stages import Evaluate, Intervene, Record, Repair, Report
from pipeline.config.values import MAX_N, Count, Demonstrations, Group, Margins, Name, Seeds, Whole, each_once, need
from pipeline.config.world import Demos, Scenes


class Splits(Group):
    seen_scenes: None
    new_scenes: str
    new_items: str


class Protocol(Group):
    name: str
    seeds: Seeds
    splits: Splits


class Settings(Group):
    """All of conf/, as params.yaml holds it."""

    seeds: Seeds
    validation_seeds: Seeds
    n_demos: Annotated[list[Demonstrations], Field(min_length=1), AfterValidator(each_once)]
    main_n_demos: int
    checkpoints: Annotated[list[Whole], AfterValidator(each_once)]
    variant: str
    seed: Whole | None
    workers: Count
    paths: dict[str, str]
    users: Annotated[dict[Name, Margins], Field(min_length=1)]
    scenes: Scenes
    demos: Demos
    train: Train
    irl: Irl
    clearance: Schedule
    evaluate: Evaluate
    repair: Repair
    intervene: Intervene
    record: Record
    report: Report
    variants: dict[Name, Variant]
    questions: Annotated[dict[Name, Question], Field(min_length=1)]
    protocol: Protocol
    studies: dict[str, dict[str, Any]] = {}  # each study checks its own
    profile: str

    @model_validator(mode="after")
    def _agree(self) -> "Settings":
        known = [*self.seeds, *self.validation_seeds]
        shared = sorted(set(self.seeds) & set(self.validation_seeds))
        none_shared = f"none of `seeds` (shared: {shared})"
        need(not shared, "validation_seeds", self.validation_seeds, none_shared)
        need(self.main_n_demos in self.n_demos, "main_n_demos", self.main_n_demos, f"one of n_demos = {self.n_demos}")
        per_scene, most = self.demos.per_scene, max(self.n_demos)
        need(per_scene >= most, "demos.per_scene", per_scene, f"a whole number from max(n) = {most} to {MAX_N}")
        need(self.variant in self.variants, "variant", self.variant, f"one of {', '.join(self.variants)}")
        own = f"null or one of protocol.seeds, {self.protocol.seeds} under protocol={self.protocol.name}"
        need(self.seed is None or self.seed in self.protocol.seeds, "seed", self.seed, own)
        some = set(self.protocol.seeds) <= set(known)
        need(some, "protocol.seeds", self.protocol.seeds, f"a list of some of {known}")
        some_users = len(self.evaluate.users) > 0 and set(self.evaluate.users) <= set(self.users)
        need(some_users, "evaluate.users", self.evaluate.users, f"some of {', '.join(self.users)}")
        return self
