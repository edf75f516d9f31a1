"""Without the extra `robot` the study's tests are left out."""

from importlib.util import find_spec

from pipeline.robot import PACKAGES

collect_ignore = ["test_execution_study.py"] if any(find_spec(name) is None for name in PACKAGES) else []
