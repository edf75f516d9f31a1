"""What conf/ may hold: the type and range of every parameter, group by group, as pydantic checks them.

A group that a class of the library takes has its types alone here, for that class keeps its ranges (Schedule, Weights,
Jitter, Ascent, Near, Hand). What parameters must be to what a stage finds, its stage says.
"""

from pipeline.schema.settings import Settings
from pipeline.schema.wording import sentence

__all__ = ["Settings", "sentence"]
