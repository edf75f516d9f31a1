"""Studies beyond the paper, one folder per question; deleting a folder removes its study."""

from pipeline.runtime.instructions import fix_instructions

fix_instructions()  # before a stage imports numpy and torch
