"""Say which scenes to show next: those about which the models of different folds disagree most."""

import numpy as np
import pandas as pd

from pipeline.own.data import Scenes
from pipeline.own.fitting import Fitted
from pipeline.world.bezier import lattice

SIDE = 14  # points per side of the lattice of paths


def disagreement(fitted: Fitted, scenes: Scenes) -> pd.DataFrame:
    """Return one row for each picture, most disagreement first.

    disagreement: standard deviation of P(valid) over the models, averaged over a lattice of paths; shown: whether the
    user has demonstrations there. Scenes without any come first, as only they are new to all models.
    """
    paths = np.broadcast_to(lattice(SIDE), (len(scenes.names), SIDE**2, 2))
    p = np.stack([model.probability(scenes.images, paths) for model in fitted.fold_models])
    table = pd.DataFrame(
        {"user": fitted.data.user, "scene": scenes.names, "disagreement": p.std(0).mean(1).astype(float)}
    )
    table["shown"] = table["scene"].isin(fitted.data.scenes)
    return table.sort_values(["shown", "disagreement"], ascending=[True, False], ignore_index=True)
