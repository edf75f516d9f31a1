"""Parameters of the study (conf/studies/perception.yaml) and their constraints."""

from typing import Any

from pipeline.runtime.settings import Count, Group, Some, StudyGroup, Whole, need, need_one


class Headlines(Group):
    """The splits behind the accuracies of transfer.clearance in metrics.json."""

    taught_tops: str
    held_out_tops: str


class Settings(StudyGroup):
    pictures: Count
    folder: str
    rendered: Some
    headlines: Headlines
    paths: Count
    root_seed: Whole


def agree(study: Settings, parameters: Any) -> None:
    """Reject headlines on splits that are not judged, and parameters without the variant that is."""
    for name, split in study.headlines:
        need_one(f"studies.perception.headlines.{name}", split, study.rendered)
    need("clearance" in parameters.variants, "variants", list(parameters.variants), "clearance among them")
