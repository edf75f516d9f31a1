"""The environment that has Blender holds all that its script imports."""

import sys
from pathlib import Path

import grimp

NAMES = {"cv2": "opencv-python-headless", "yaml": "pyyaml"}  # of packages called otherwise than their modules


def test_every_package_that_rendering_imports_is_pinned_and_no_other():
    graph = grimp.build_graph("pipeline", "making", cache_dir=None, include_external_packages=True)
    own = {module for module in graph.modules if module.startswith("making.render")}
    imported = {name for name in own.union(*map(graph.find_upstream_modules, own)) if graph.is_module_squashed(name)}
    lines = Path("making/render/requirements.txt").read_text().splitlines()
    pinned = {line.partition("==")[0] for line in lines if not line.startswith("#")}
    assert {NAMES.get(name, name) for name in imported - sys.stdlib_module_names} == pinned
