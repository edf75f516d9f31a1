"""Every annotated shape and type of the package is checked while the tests run.

Hypothesis tries the same examples in every run; `--hypothesis-profile=default` draws new ones.
"""

from hypothesis import settings
from jaxtyping import install_import_hook

from pipeline.memory import keep_freed

install_import_hook("pipeline", "beartype.beartype")
keep_freed()  # as every stage's process does
settings.register_profile("repeatable", derandomize=True)
settings.load_profile("repeatable")
