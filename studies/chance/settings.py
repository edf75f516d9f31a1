"""Parameters of the page on the paper's model (conf/studies/chance.yaml)."""

from pipeline.config.settings import Settings as Parameters
from pipeline.config.values import Share, StudyGroup


class Settings(StudyGroup):
    accuracy: Share
    q1: Share
    q3: Share


def agree(study: Settings, parameters: Parameters) -> None:
    """Require nothing beyond each parameter's own constraints."""
