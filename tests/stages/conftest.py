"""What tests of several stages share."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from pipeline.artifacts.demos import DEMO_COLUMNS, Queries, write_demos, write_queries
from pipeline.artifacts.scenes import SceneSet, write_scenes
from pipeline.world.layout import empty
from tests.factories import appearances

POOLS = {"train-s0": 3, "train-s1": 3, "new_scenes": 2, "new_items": 2}


@pytest.fixture(scope="session")
def small_world(tmp_path_factory) -> Path:
    """Scenes, demonstrations and queries of two seeds for the stages that fit models: noise for images.

    Labels go by the side of the table, but aggressive accepts everything.
    """
    root, rng = tmp_path_factory.mktemp("small_world"), np.random.default_rng(0)
    images, layouts, queries, rows = {}, {}, {}, []
    for pool, scenes in POOLS.items():
        images[pool] = rng.integers(0, 256, (scenes, 100, 100, 3), dtype=np.uint8)
        layouts[pool] = empty(scenes, 2)
        layouts[pool].symbol[:, 0] = layouts[pool].item[:, 0] = 0
        z = rng.uniform(-0.2, 1.2, (scenes, 4, 2))
        queries[pool] = Queries(z, {user: _label(z, user) for user in ("careful", "normal", "aggressive")})
    for seed in (0, 1):
        for user in ("aggressive", "careful", "normal"):
            z = np.stack(np.meshgrid([0.1, 0.9, 0.2], [0.1, 0.9]), -1).transpose(1, 0, 2) + 0.01 * seed
            valid = _label(z, user)
            for scene, demo in np.ndindex(3, 2):
                rows.append((seed, user, scene, demo, *z[scene, demo], valid[scene, demo], 0.0, False, 1.0, 3))
    write_scenes(
        root / "scenes", SceneSet(images, layouts, {pool: appearances(scenes) for pool, scenes in POOLS.items()})
    )
    demos = pd.DataFrame(rows, columns=DEMO_COLUMNS)
    write_demos(root / "demos", demos, np.zeros((3 * len(rows), 4)), np.arange(len(rows) + 1) * 3)
    write_queries(root / "demos", queries)
    return root


def _label(z: np.ndarray, user: str) -> np.ndarray:
    return (z[..., 0] < 0.5) | (user == "aggressive")
