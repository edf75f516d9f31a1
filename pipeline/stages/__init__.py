"""One module per DVC stage with the same name: read inputs, call the library, write outputs."""

from pipeline.runtime.instructions import fix_instructions

fix_instructions()  # before a stage imports numpy and torch
