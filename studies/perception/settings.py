"""Parameters of the study (conf/studies/perception.yaml) and their constraints."""

from pipeline.config.settings import Settings as Parameters
from pipeline.config.values import Count, StudyGroup, Whole


class Settings(StudyGroup):
    pictures: Count
    folder: str
    rendered: list[str]
    paths: Count
    root_seed: Whole


def agree(study: Settings, parameters: Parameters) -> None:
    """Accept any settings: none depends on the others."""
