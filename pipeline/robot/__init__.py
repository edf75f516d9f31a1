"""Carry out paths with a robot's arm: postures, timing, clearances in three dimensions, physics, export.

The modules need the packages of the extra `robot`.
"""

from importlib.util import find_spec

from pipeline.runtime.errors import InputError

PACKAGES = ("coal", "daqp", "mujoco", "pinocchio", "pink", "rosbags", "rtbdata", "xacrodoc")


def need_packages() -> None:
    """Raise InputError if a package of the extra is missing."""
    if missing := [name for name in PACKAGES if find_spec(name) is None]:
        raise InputError(f"the robot needs {', '.join(missing)}: run `pip install .[robot]`")
