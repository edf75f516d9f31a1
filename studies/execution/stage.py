"""Stage execution: carry out the repaired paths with robot arms, joint by joint and in a simulation of physics."""

from pathlib import Path

from omegaconf import DictConfig

from pipeline.launch import launch
from pipeline.robot import need_packages


def main(cfg: DictConfig, out_dir: Path) -> None:
    """Write placement.csv, postures.npz, executions.parquet, summary.csv, physics.parquet, touched.csv, shown.npz,
    trajectories.json and the ROS 2 bag `bag`. Raise InputError if a package of the extra `robot` is missing.
    """
    need_packages()
    from studies.execution.run import run  # its modules need those packages

    run(cfg, out_dir)


if __name__ == "__main__":
    launch(main, "execution")
