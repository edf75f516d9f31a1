"""Parameters of the page on expectations (conf/studies/sealed.yaml)."""

from pipeline.config.settings import Settings as Parameters
from pipeline.config.values import StudyGroup


class Settings(StudyGroup):
    pass


def agree(study: Settings, parameters: Parameters) -> None:
    """Accept any settings: there is only the question."""
