"""Parameters of the ceiling study (conf/studies/ceiling.yaml) and their constraints."""

from typing import Annotated, Any

from pydantic import AfterValidator

from pipeline.runtime.settings import Count, Several, StudyGroup, Weight, Whole, expected, need, need_some, rising

Numbers = Annotated[list[Count], AfterValidator(rising), expected("ascending whole numbers from 1")]


class Settings(StudyGroup):
    root_seed: Whole
    scenes: dict[str, Numbers]
    batch: Count
    growth: Weight
    clear_cm: Annotated[list[Whole], AfterValidator(rising), expected("ascending whole numbers from 0 [cm]")]
    candidates: Count
    seeds: dict[str, Several]
    seen_scenes: Count
    new_scenes: Several
    paths: Count


def agree(study: Settings, parameters: Any) -> None:
    """Require known learners, with seeds, and training scenes enough to judge them in."""
    name, variants = "studies.ceiling", parameters.variants
    known = [*(v for v in variants if variants[v].kind == "vae"), "perfect"]
    need_some(f"{name}.scenes", study.scenes, known)
    need(set(study.scenes) <= set(study.seeds), f"{name}.seeds", study.seeds, "a number for each learner of `scenes`")
    need(study.clear_cm[0] == 0, f"{name}.clear_cm", study.clear_cm, "0 first: the page shows it")
    paths = parameters.main_n_demos + study.paths
    need(study.candidates >= paths, f"{name}.candidates", study.candidates, f"at least main_n_demos + paths = {paths}")
    fewest = min(numbers[0] for numbers in study.scenes.values())
    need(study.seen_scenes <= fewest, f"{name}.seen_scenes", study.seen_scenes, f"at most {fewest}, as in `scenes`")
