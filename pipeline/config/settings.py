"""All parameters together, and the constraints between groups."""

from collections import Counter
from importlib import import_module
from typing import Annotated, Any

from pydantic import AfterValidator, Field, model_validator

from pipeline.causal.questions import Question
from pipeline.config.graph import ROOT
from pipeline.config.models import Irl, Schedule, Train, Variant
from pipeline.config.stages import Evaluate, Intervene, Readings, Record, Repair, Report
from pipeline.config.world import Demos, Scenes
from pipeline.models.baselines import IMAGE_BLIND_BASELINES, NEAREST
from pipeline.runtime.settings import (
    MAX_N,
    Count,
    Demonstrations,
    Group,
    Margins,
    Name,
    Seeds,
    Whole,
    need,
    need_one,
    need_some,
    unique,
    widest_margin,
)

MAX_TESTS = 25  # with 10 seeds the smallest p is 2/1024: under Holm's correction more tests could never be significant


class Splits(Group):
    """split -> pool of scenes; null: the training scenes of each seed."""

    seen_scenes: None
    new_scenes: str
    new_items: str


class Protocol(Group):
    """Parameters of conf/protocol/*.yaml: the training sets that are fitted, and the pools for evaluation."""

    name: str
    seeds: Seeds
    splits: Splits


class Settings(Group):
    """All of conf/, as in params.yaml. The validation context lists the stages about to run."""

    seeds: Seeds
    validation_seeds: Seeds
    n_demos: Annotated[list[Demonstrations], Field(min_length=1), AfterValidator(unique)]
    main_n_demos: int
    checkpoints: Annotated[list[Whole], AfterValidator(unique)]
    variant: str
    seed: Whole | None
    composed: list[str]
    workers: Count
    paths: dict[str, str]
    users: Annotated[dict[Name, Margins], Field(min_length=1)]
    scenes: Scenes
    demos: Demos
    train: Train
    irl: Irl
    clearance: Schedule
    evaluate: Evaluate
    readings: Readings
    repair: Repair
    intervene: Intervene
    record: Record
    report: Report
    variants: Annotated[dict[Name, Variant], Field(min_length=1)]
    questions: Annotated[dict[Name, Question], Field(min_length=1)]
    protocol: Protocol
    studies: dict[str, dict[str, Any]] = Field(default_factory=dict)  # each study checks its own (`check_study`)
    profile: str

    @model_validator(mode="after")
    def _agree(self, info) -> "Settings":  # info: pydantic's ValidationInfo, which beartype cannot check
        shared = sorted(set(self.seeds) & set(self.validation_seeds))
        need(not shared, "validation_seeds", self.validation_seeds, f"none of `seeds` (shared: {shared})")
        need(self.main_n_demos in self.n_demos, "main_n_demos", self.main_n_demos, f"one of n_demos = {self.n_demos}")
        per_scene, most = self.demos.per_scene, max(self.n_demos)
        need(per_scene >= most, "demos.per_scene", per_scene, f"a whole number from max(n_demos) = {most} to {MAX_N}")
        need_one("variant", self.variant, self.variants)
        seeds, name = self.protocol.seeds, self.protocol.name
        known = [*self.seeds, *self.validation_seeds]
        need(set(seeds) <= set(known), "protocol.seeds", seeds, f"a list of some of {known}")
        one_of = f"null or one of protocol.seeds, {seeds} under protocol={name}"
        need(self.seed is None or self.seed in seeds, "seed", self.seed, one_of)
        need_some("evaluate.users", self.evaluate.users, self.users)
        for stage in info.context or ():
            if stage in NEEDS:
                NEEDS[stage](self)
        return self


def need_several_seeds(s: Settings) -> None:
    """Reject a single seed, which gives no interval."""
    need(len(s.protocol.seeds) > 1, "protocol.seeds", s.protocol.seeds, "at least 2 seeds, or intervals mean nothing")


def evaluate(s: Settings) -> None:
    """Reject comparisons that cannot be made, and more than MAX_TESTS in a family."""
    need_several_seeds(s)
    splits, counts = dict(s.protocol.splits), Counter()
    several = s.scenes.validation > 1 or not {"val_scenes", "val_items"} & set(splits.values())
    need(several, "scenes.validation", s.scenes.validation, "at least 2, or intervals over scenes mean nothing")
    for c in s.evaluate.comparisons:
        for name in (c.variant, *c.against):
            need_one("evaluate.comparisons", name, [*s.variants, *IMAGE_BLIND_BASELINES])
        for split in c.splits:
            judged = split in splits and (NEAREST not in (c.variant, *c.against) or splits[split] is None)
            where = f"one of {', '.join(splits)}; {NEAREST} has demonstrations only in seen scenes"
            need(judged, "evaluate.comparisons", f"{c.variant} against {', '.join(c.against)} on {split}", where)
        counts[c.family] += len(c.against) * len(c.splits) * ((c.n_demos or s.main_n_demos) in s.n_demos)
    for family, count in counts.items():
        few = f"at most {MAX_TESTS}, or Holm's correction leaves nothing to be found"
        need(count <= MAX_TESTS, "evaluate.comparisons", f"{count} tests in family {family}", few)


def readings(s: Settings) -> None:
    """Reject numbers of demonstrations without main_n_demos, at which every reading ends, and too few candidates."""
    need_several_seeds(s)
    least = f"main_n_demos = {s.main_n_demos} among them, at which every reading ends"
    need(s.main_n_demos in s.readings.n_demos, "readings.n_demos", s.readings.n_demos, least)
    paths = s.main_n_demos + s.readings.held_out
    most = f"at least main_n_demos + held_out = {paths}"
    need(s.readings.candidates >= paths, "readings.candidates", s.readings.candidates, most)


def repair(s: Settings) -> None:
    """Reject users whose paths are all valid."""
    need_several_seeds(s)
    need(widest_margin(s.users) is not None, "users", s.users, "at least one user with a margin, or no path is invalid")


def intervene(s: Settings) -> None:
    """Reject questions about another user if that user is unknown, or if there is only one."""
    need_several_seeds(s)
    for name, question in s.questions.items():
        if question.kind == "user":
            need(len(s.users) > 1, "users", list(s.users), f"at least 2 users for question {name}")
            if question.to is not None:
                need_one(f"questions.{name}.to", question.to, s.users)


def record(s: Settings) -> None:
    """Reject unknown variants, and different splits, since a recording shows repairs and interventions together."""
    need_some("record.first", s.record.first, s.variants, or_none=True)
    same = f"repair.split = {s.repair.split!r}, since a recording shows both"
    need(s.intervene.split == s.repair.split, "intervene.split", s.intervene.split, same)


def report(s: Settings) -> None:
    """Reject unknown variants."""
    need_some("report.shown", s.report.shown, s.variants)


# stage -> its constraints between groups; a study's constraints are in its settings.py
NEEDS = {
    "evaluate": evaluate, "readings": readings, "repair": repair, "intervene": intervene, "record": record,
    "report": report,
}  # fmt: skip


def is_study(name: str) -> bool:
    """Return whether the study's folder has settings."""
    return (ROOT / "studies" / name / "stage.py").is_file()


def check_study(name: str, settings: Settings, agree: bool) -> None:
    """Raise pydantic's ValidationError for a study's invalid parameters.

    With `agree`, also raise PydanticCustomError if they conflict with other groups.
    """
    module = import_module(f"studies.{name}.stage")
    module = module if hasattr(module, "Settings") else import_module(f"studies.{name}.settings")
    study = module.Settings.model_validate(settings.studies.get(name, {}))
    if agree:
        need_several_seeds(settings)
        module.agree(study, settings)
