"""Place the arms, carry out all paths, simulate some, and write tables, pictures and trajectories."""

import json
import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from jaxtyping import Float
from numpy import ndarray as Array
from omegaconf import DictConfig, OmegaConf

from pipeline.artifacts.demos import read_demos
from pipeline.artifacts.files import write_arrays, write_json, write_table
from pipeline.artifacts.scenes import read_scenes, train_pool
from pipeline.robot.carried import clearances
from pipeline.robot.execution import FAILURES
from pipeline.robot.export import trajectory, write_bag
from pipeline.robot.motion import lengths
from pipeline.robot.physics import simulate
from pipeline.runtime.parallel import map_jobs
from pipeline.world.layout import Layouts, concatenated
from studies.execution.paths import GROUP, KEY, REPAIRS, UNREPAIRED, all_paths
from studies.execution.placement import place
from studies.execution.shown import shown
from studies.execution.work import Work

PUSHED = 50  # simulated executions of one job
ALL = "all"  # variants or users of a row of the summary
CLOSE = 0.05  # quantile of clearances in the summary


@dataclass(frozen=True)
class Job:
    """Some paths of one arm, each with its scene."""

    work: Work
    z_theta: Float[Array, "path 2"]
    layouts: Layouts


def run(cfg: DictConfig, out_dir: Path) -> None:
    """Write the results of the study (see stage.py)."""
    study, pool = cfg.studies.execution, cfg.protocol.splits[cfg.repair.split]
    scenes, demos = read_scenes(Path(cfg.paths.scenes)), read_demos(Path(cfg.paths.demos))
    scenes.check_has(pool, *map(train_pool, cfg.protocol.seeds))
    paths = all_paths(cfg, scenes, demos)
    keys = paths[KEY].drop_duplicates(ignore_index=True).sort_values(KEY, ignore_index=True)
    pools = list(scenes.layouts)
    layouts, first = concatenated(list(scenes.layouts.values())), np.cumsum([0, *map(len, scenes.layouts.values())])
    scene = first[[pools.index(name) for name in keys["pool"]]] + keys["scene"].to_numpy()
    z_theta, of_key = keys[["z_x", "z_y"]].to_numpy(), layouts[scene]

    training = demos[demos["seed"] == cfg.protocol.seeds[0]][["z_x", "z_y"]].to_numpy()
    speed = float((lengths(demos[["z_x", "z_y"]].to_numpy()) / demos["duration_s"]).median())
    tallest = max(solid.height_m for solid in study.solids.values())
    works, tried, executed = {}, [], []
    for name, settings in study.arms.items():
        plain: Any = OmegaConf.to_container(settings)
        bench, postures, rows = place(str(name), plain, study, training, tallest, cfg.workers)
        tried.append(rows)
        work = works[name] = Work(str(name), json.dumps(plain), bench, postures, study, speed)
        jobs = [
            Job(work, z_theta[i : i + study.chunk], of_key[i : i + study.chunk])
            for i in range(0, len(keys), study.chunk)
        ]
        results = pd.concat(map_jobs(carry_out, jobs, cfg.workers, f"{name} carries out"), ignore_index=True)
        executed.append(paths.merge(pd.concat([keys, results], axis=1), on=KEY, how="left").assign(arm=name))
    executions = pd.concat(executed, ignore_index=True)
    write_table(out_dir / "placement.csv", pd.concat(tried, ignore_index=True).assign(speed_m_s=speed))
    write_arrays(out_dir / "postures.npz", {f"{name}/status": work.postures.status for name, work in works.items()})
    write_table(out_dir / "executions.parquet", executions)
    write_table(out_dir / "summary.csv", summary(executions))

    work = works[study.physics_arm]
    chosen = simulated_paths(cfg, paths)
    jobs = [
        Job(work, part[["z_x", "z_y"]].to_numpy(), scenes.layouts[pool][part["scene"].to_numpy()])
        for _, part in chosen.groupby(chosen.index // PUSHED)
    ]
    outcomes = pd.concat(map_jobs(push, jobs, cfg.workers, "physics"), ignore_index=True)
    physics = pd.concat([chosen.reset_index(drop=True), outcomes], axis=1)
    write_table(out_dir / "physics.parquet", physics)
    write_table(out_dir / "touched.csv", touched(physics))

    method, variants = list(study.physics.items())[-1]
    mine = (paths["method"] == method) & (paths["variant"] == variants[0]) & (paths["user"] == next(iter(cfg.users)))
    repaired = paths[mine & (paths["seed"] == cfg.protocol.seeds[0])]
    export(work, repaired.head(study.exported), out_dir)
    write_arrays(out_dir / "shown.npz", shown(work, repaired, paths, scenes.images[pool], scenes.layouts[pool]))


def carry_out(job: Job) -> pd.DataFrame:
    """Return a row a path: how it was executed, and the least clearance [m] of shaker and gripper from any item."""
    motion = job.work.run(job.z_theta)
    near = [
        clearances(part, motion.grip, motion.heading, job.layouts, job.work.bench.side_m, job.work.heights()).min(1)
        for part in job.work.parts()
    ]
    return motion.results.assign(shaker_m=near[0], gripper_m=near[1])


def summary(executions: pd.DataFrame) -> pd.DataFrame:
    """Return a row for each arm, method, variant and user, and for each method with all of its paths (variant and user
    "all"); method "repairs": both kinds of repair.

    executed and failures: shares of accepted paths; touching: share of accepted paths on which shaker or gripper meets
    an item; valid, touching_valid: numbers of accepted paths that are truly valid, and of those that meet an item.
    """
    together = executions.assign(variant=ALL, user=ALL)
    repairs = together[together["method"].isin(REPAIRS)].assign(method="repairs")
    rows = []
    for group, part in pd.concat([executions, together, repairs]).groupby(["arm", *GROUP], sort=False):
        accepted = part[part["accepted"]]
        meets = accepted[["shaker_m", "gripper_m"]].min(axis=1)
        row = dict(zip(["arm", *GROUP], group, strict=True)) | {"paths": len(part), "accepted": len(accepted)}
        row |= {"valid": int(accepted["valid"].sum()), "touching_valid": int((meets[accepted["valid"]] < 0).sum())}
        if len(accepted):
            row |= {name or "executed": float((accepted["failure"] == name).mean()) for name in FAILURES}
            row |= {"error_mean_mm": 1e3 * accepted["error_mean_m"].mean()}
            row |= {"error_max_mm": 1e3 * accepted["error_max_m"].max(), "duration_s": accepted["duration_s"].mean()}
            row |= {"speed_share": accepted["speed_share"].max(), "clearance_mm": 1e3 * meets.quantile(CLOSE)}
            row |= {"touching": float((meets < 0).mean())}
        rows.append(row)
    return pd.DataFrame(rows)


def simulated_paths(cfg: DictConfig, paths: pd.DataFrame) -> pd.DataFrame:
    """Return the paths that are simulated: the first random ones of each scene, for each user and repair.

    A path that is valid to the user is carried out as it is; a repaired one otherwise. Method "unrepaired": all as
    they are.
    """
    study, parts = cfg.studies.execution, []
    few = paths[(paths["start"] < study.physics_starts) & (paths["seed"] == cfg.protocol.seeds[0])]
    as_drawn = few[few["method"] == UNREPAIRED]
    parts.append(as_drawn)
    for method, variants in study.physics.items():
        for variant in variants:
            repaired = few[(few["method"] == method) & (few["variant"] == variant)]
            kept = as_drawn[as_drawn["valid"] & as_drawn["user"].isin(repaired["user"].unique())]
            parts.append(pd.concat([kept.assign(method=method, variant=variant), repaired]))
    return pd.concat(parts, ignore_index=True).sort_values([*GROUP, "scene", "start"], ignore_index=True)


def push(job: Job) -> pd.DataFrame:
    """Return a row an execution: numbers of items touched, moved and fallen, and the farthest displacement [m]."""
    study, motion, rows = job.work.study, job.work.run(job.z_theta), []
    for i, duration in enumerate(motion.results["duration_s"]):
        outcome = simulate(
            job.layouts, i, job.work.bench.side_m, job.work.solids(), job.work.parts(), motion.grip[i],
            motion.heading[i], duration, study.fallen_rad,
        )  # fmt: skip
        counts = {"touched": outcome.touched.sum(), "moved": (outcome.moved_m > study.moved_m).sum()}
        rows.append(counts | {"fallen": outcome.fallen.sum(), "farthest_m": outcome.moved_m.max()})
    return pd.DataFrame(rows)


def touched(physics: pd.DataFrame) -> pd.DataFrame:
    """Return, for each method, variant and user, executions and the shares with items touched, moved or fallen.

    touched, touched_valid: numbers of executions, and of those of truly valid paths, in which an item is touched.
    """
    rows = []
    for group, part in physics.groupby(GROUP, sort=False):
        met = {f"{what}_share": float((part[what] > 0).mean()) for what in ("touched", "moved", "fallen")}
        of_valid = part[part["valid"]]
        met |= {"valid": float(part["valid"].mean()), "touched_valid": int((of_valid["touched"] > 0).sum())}
        counts = {"executions": len(part), "touched": int((part["touched"] > 0).sum())}
        rows.append(dict(zip(GROUP, group, strict=True)) | counts | met)
    return pd.DataFrame(rows)


def export(work: Work, paths: pd.DataFrame, out_dir: Path) -> None:
    """Write the paths' executions to trajectories.json and to the ROS 2 bag `bag`."""
    motion = work.run(paths[["z_x", "z_y"]].to_numpy())
    moves = {
        f"scene{row.scene}_start{row.start}": trajectory(work.arm.joints, q, duration)
        for row, q, duration in zip(paths.itertuples(), motion.q, motion.results["duration_s"], strict=True)
    }
    write_json(out_dir / "trajectories.json", moves)
    shutil.rmtree(out_dir / "bag", ignore_errors=True)
    write_bag(out_dir / "bag", moves, work.arm.model.frames[1].name)
