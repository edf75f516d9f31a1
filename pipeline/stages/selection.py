"""Stage selection: copy the recordings that git keeps, so that a clone has some to open without running anything.

They are the overview, and the run with the lowest accuracy of each variant that is `compared`.
"""

import shutil
from pathlib import Path

from omegaconf import DictConfig

from pipeline.artifacts.files import read_table
from pipeline.artifacts.models import compared
from pipeline.launch import launch
from pipeline.runtime.errors import InputError
from pipeline.runtime.writing import atomic_write
from pipeline.viewer.digest import digest


def main(cfg: DictConfig, out_dir: Path) -> None:
    """Copy recordings.csv and the selected recordings; a file of the same contents keeps its bytes.

    Raises InputError where stage record's table came from DVC's cache, without the recordings that it lists.
    """
    listed = Path(cfg.paths.record) / "recordings.csv"
    table = read_table(listed)
    table = table.set_index("run")
    worst = table.groupby("variant")["accuracy"].idxmin()
    names = [f"{run}.rrd" for run in ("overview", *worst[compared(cfg)])]
    out_dir.mkdir(parents=True, exist_ok=True)
    for path in out_dir.glob("*.rrd"):
        if path.name not in names:
            path.unlink()
    for name in names:
        kept, new = out_dir / name, Path(cfg.paths.record) / "runs" / name
        if not kept.is_file() or digest(kept) != table.loc[new.stem, "sha256"]:
            if not new.is_file():
                again = "python -m pipeline.stages.record --params params.yaml"
                raise InputError(f"{new} is missing: write it by `{again}`")
            atomic_write(kept, lambda part, new=new: shutil.copyfile(new, part))
    atomic_write(out_dir / "recordings.csv", lambda part: shutil.copyfile(listed, part))


if __name__ == "__main__":
    launch(main, "selection")
