"""Parameters of the search study (conf/studies/search.yaml) and their constraints."""

from typing import Annotated

from pydantic import Field, model_validator

from pipeline.config.checks import need
from pipeline.config.settings import Settings as Parameters
from pipeline.config.values import Count, Group, Several, StudyGroup, Whole, expected

Ends = Annotated[list[float], Field(min_length=2, max_length=2)]


class Range(Group):
    """Values of one searched parameter: evenly in the logarithm, evenly, or one of a list."""

    log: Ends | None = None
    even: Ends | None = None
    one_of: Annotated[list[int | bool], Field(min_length=1)] | None = None

    @model_validator(mode="after")
    def _one(self) -> "Range":
        given = [self.log, self.even, self.one_of]
        if sum(values is not None for values in given) != 1:
            raise ValueError
        ends = self.log or self.even or [0, 1]
        if not ends[0] < ends[1] or (self.log is not None and ends[0] <= 0):
            raise ValueError
        return self


Ranges = Annotated[
    dict[str, Annotated[Range, expected("log: [low, high], even: [low, high] or one_of: [values]")]],
    Field(min_length=1),
]


class Settings(StudyGroup):
    root_seed: Whole
    training_set: Whole
    settings: Count
    startup: Count
    together: Count
    ensembles: Count
    members: Several
    repeats: Several
    seeds: Several
    space: dict[str, Ranges]


def agree(study: Settings, parameters: Parameters) -> None:
    """Require a training set of validation, and a space for every kind of learner."""
    name, known = "studies.search", parameters.validation_seeds
    need(study.training_set in known, f"{name}.training_set", study.training_set, f"one of validation_seeds = {known}")
    kinds = {variant.kind for variant in parameters.variants.values()}
    need(kinds <= set(study.space), f"{name}.space", list(study.space), f"ranges for {', '.join(sorted(kinds))}")
    fewer = "at most settings, which they are the best of"
    need(study.ensembles <= study.settings, f"{name}.ensembles", study.ensembles, fewer)
