"""What conf/ may hold: the type and range of every parameter, group by group, as pydantic checks them.

What those of one group must be to those of others stands in `settings` and, for what single stages need, `agreement`.
What parameters must be to what a stage finds, its stage says.
"""

from pipeline.config.agreement import AGREEMENTS, Agreed
from pipeline.config.wording import sentence

__all__ = ["AGREEMENTS", "Agreed", "sentence"]
