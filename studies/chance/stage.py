"""Stage chance: set results about the paper's model side by side, and mark those that reach the paper's rate.

It reads the convergence and the accuracy of stage evaluate, and the studies search, demonstrations and ceiling.
"""

from pathlib import Path

import pandas as pd
from omegaconf import DictConfig

from pipeline.artifacts.files import read_table, write_table
from pipeline.launch import launch
from pipeline.models.baselines import NEAREST, POSITION

MODEL, PERFECT = "full", "perfect"
KEY = ["source", "learner", "setting", "routes", "clear_cm", "scenes", "split"]
RESULTS = ["accuracy", "q1", "q3", "seeds"]


def main(cfg: DictConfig, out_dir: Path) -> None:
    """Write convergence.csv, and accuracy.csv: a row for each source, learner and condition.

    reaches: whether the mean is at least the paper's lower quartile.
    """
    evaluate, studies = Path(cfg.paths.evaluate), Path(cfg.paths.studies)
    convergence = read_table(evaluate / "convergence.csv")
    fits = len(cfg.protocol.seeds) * len(cfg.evaluate.users)
    write_table(out_dir / "convergence.csv", convergence[convergence["variant"] == MODEL].assign(fits=fits))
    evaluated = read_table(evaluate / "accuracy.csv").rename(columns={"variant": "learner", "mean": "accuracy"})
    evaluated = evaluated[evaluated["n_demos"] == cfg.main_n_demos]
    search = read_table(studies / "search" / "summary.csv")
    search = search[search["setting"] == "best"]
    shown = read_table(studies / "demonstrations" / "summary.csv").rename(columns={"variant": "learner"})
    ceiling = read_table(studies / "ceiling" / "summary.csv")
    parts = {"evaluate": evaluated.assign(setting="default"), "search": search}
    parts |= {"demonstrations": shown, "ceiling": ceiling}
    table = pd.concat([part.assign(source=source) for source, part in parts.items()], ignore_index=True)
    table = table[table["learner"].isin([MODEL, PERFECT, NEAREST, POSITION]) & (table["split"] != "demonstrations")]
    table = table.reindex(columns=[*KEY, *RESULTS])
    table[["clear_cm", "scenes"]] = table[["clear_cm", "scenes"]].astype("Int64")  # empty where a source has no such
    write_table(out_dir / "accuracy.csv", table.assign(reaches=table["accuracy"] >= cfg.studies.chance.q1))


if __name__ == "__main__":
    launch(main, "chance")
