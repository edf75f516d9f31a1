"""Parameters of the ceiling study (conf/studies/ceiling.yaml) and their constraints."""

from typing import Annotated

from pydantic import AfterValidator

from pipeline.config.checks import need, need_some
from pipeline.config.settings import Settings as Parameters
from pipeline.config.values import Count, Several, StudyGroup, Whole, expected, rising

Numbers = Annotated[list[Count], AfterValidator(rising), expected("ascending whole numbers from 1")]


class Settings(StudyGroup):
    root_seed: Whole
    scenes: dict[str, Numbers]
    seeds: dict[str, Several]
    seen_scenes: Count
    new_scenes: Several
    paths: Count


def agree(study: Settings, parameters: Parameters) -> None:
    """Require known learners, with seeds, and training scenes enough to judge them in."""
    name, variants = "studies.ceiling", parameters.variants
    known = [*(v for v in variants if variants[v].kind == "vae"), "coordinates", "path_drawn", "perfect"]
    need_some(f"{name}.scenes", study.scenes, known)
    need("classifier" in variants, "variants", list(variants), "classifier among them: its weights of Eq. 1 are used")
    need(set(study.scenes) <= set(study.seeds), f"{name}.seeds", study.seeds, "a number for each learner of `scenes`")
    fewest = min(numbers[0] for numbers in study.scenes.values())
    need(study.seen_scenes <= fewest, f"{name}.seen_scenes", study.seen_scenes, f"at most {fewest}, as in `scenes`")
