"""The PR2 carries out paths: where table and base stand, what it executes, and what it pushes."""

import shutil
from dataclasses import dataclass
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from jaxtyping import Float
from numpy import ndarray as Array
from omegaconf import DictConfig

from pipeline.artifacts.demos import read_demos
from pipeline.artifacts.files import read_table, write_arrays, write_table
from pipeline.artifacts.scenes import SceneSet, read_scenes, train_pool
from pipeline.robot.arm import Arm, Bench, load_arm
from pipeline.robot.carried import Part, gripper_of, simulate
from pipeline.robot.execution import FAILURES, Motion, execute, lengths, minimum_jerk, write_bag
from pipeline.robot.inverse import PostureMap, posture_map
from pipeline.runtime.errors import InputError
from pipeline.runtime.parallel import map_jobs
from pipeline.runtime.streams import stream
from pipeline.world.bezier import P_F, P_INIT, random_z_theta
from pipeline.world.layout import Layouts
from pipeline.world.rules import valid

Z = ["z_x", "z_y"]  # what an execution depends on
GROUP = ["method", "variant", "user"]
COLUMNS = [*GROUP, "seed", "pool", "scene", "start", *Z, "accepted", "valid"]
REPAIRS = "gradient", "nearest"  # methods of stage repair that have a model
UNREPAIRED, STRAIGHT, ORACLE, DEMONSTRATIONS = "unrepaired", "straight", "oracle", "demonstrations"
PUSHED = 50  # simulated executions of one job
Job = tuple[Float[Array, "path 2"], Layouts]  # paths, each with its scene


@dataclass(frozen=True)
class Work:
    """The arm in its place, with all that its executions share."""

    study: Any
    bench: Bench
    postures: PostureMap
    speed_m_s: float  # mean speed of the grip

    def run(self, z_theta: Float[Array, "path 2"]) -> Motion:
        """Carry out paths."""
        study, placed = self.study, (arm_of(self.study), self.bench, self.postures)
        return execute(*placed, z_theta, study.instants, self.speed_m_s, study.error_m, study.tilt_rad)


def arm_of(study: Any) -> Arm:
    """Return the arm, loaded once in each process."""
    return load_arm(tuple(study.posture.items()), tuple(study.still.items()))


def carry_out(cfg: DictConfig, out_dir: Path) -> None:
    """Write placement.csv, executions.parquet, summary.csv, physics.parquet, touched.csv, shown.npz and the ROS 2
    bag `bag`.
    """
    study, pool, first = cfg.studies.execution, cfg.protocol.splits[cfg.repair.split], cfg.protocol.seeds[0]
    scenes, demos = read_scenes(Path(cfg.paths.scenes)), read_demos(Path(cfg.paths.demos))
    scenes.check_has(pool, *map(train_pool, cfg.protocol.seeds))
    speed = float((lengths(demos[Z].to_numpy()) / demos["duration_s"]).median())
    bench, postures, tried = place(study, demos[demos["seed"] == first][Z].to_numpy(), cfg.workers)
    work = Work(study, bench, postures, speed)
    write_table(out_dir / "placement.csv", tried.assign(speed_m_s=speed))

    paths = all_paths(cfg, scenes, demos)
    keys = paths[Z].drop_duplicates(ignore_index=True).sort_values(Z, ignore_index=True)
    jobs = [keys[i : i + study.chunk].to_numpy() for i in range(0, len(keys), study.chunk)]
    results = pd.concat(map_jobs(partial(executed, work), jobs, cfg.workers, "the arm carries out"), ignore_index=True)
    executions = paths.merge(pd.concat([keys, results], axis=1), on=Z, how="left")
    write_table(out_dir / "executions.parquet", executions)
    write_table(out_dir / "summary.csv", summary(executions))

    chosen = simulated_paths(cfg, paths)
    parts = [part for _, part in chosen.groupby(chosen.index // PUSHED)]
    jobs = [(part[Z].to_numpy(), scenes.layouts[pool][part["scene"].to_numpy()]) for part in parts]
    outcomes = pd.concat(map_jobs(partial(push, work), jobs, cfg.workers, "physics"), ignore_index=True)
    physics = pd.concat([chosen, outcomes], axis=1)
    write_table(out_dir / "physics.parquet", physics)
    write_table(out_dir / "touched.csv", touched(physics))

    method, variants = list(study.physics.items())[-1]
    mine = (paths["method"] == method) & (paths["variant"] == variants[0]) & (paths["user"] == next(iter(cfg.users)))
    repaired = paths[mine & (paths["seed"] == first)]
    exported = repaired.head(study.exported)
    names = [f"scene{scene}_start{start}" for scene, start in zip(exported["scene"], exported["start"], strict=True)]
    motion = work.run(exported[Z].to_numpy())
    moves = zip(motion.q, motion.results["duration_s"], strict=True)
    shutil.rmtree(out_dir / "bag", ignore_errors=True)
    write_bag(out_dir / "bag", arm_of(study), dict(zip(names, moves, strict=True)))
    write_arrays(out_dir / "shown.npz", shown(work, repaired, paths, scenes.images[pool]))


def place(study: Any, z_theta: Float[Array, "path 2"], workers: int) -> tuple[Bench, PostureMap, pd.DataFrame]:
    """Return table and base, a fine map of postures, and a row for each placement tried.

    z_theta: the demonstrations that judge it, those left out that cross the table's edge. Sizes are tried from the
    largest down to the first at which some base executes every demonstration, and the base is the first such one. If
    there is no such size, the placement that executes most. Raise InputError if that is none.
    """
    points, tried, benches = minimum_jerk(z_theta, study.instants), [], []
    points = points[(np.abs(points - 0.5) <= 0.5).all((1, 2))]
    for side_m in sorted(study.side_m, reverse=True):
        bases = product(study.base_x, study.base_y_m)
        here = [Bench(side_m, x * side_m, y, study.height_m, study.grip_m) for x, y in bases]
        rows = map_jobs(partial(judge, study, points), here, workers, f"a table of {side_m:g} m")
        tried, benches = tried + rows, benches + here
        if any(row["executed"] == 1 for row in rows):
            break
    best = int(np.argmax([row["executed"] for row in tried]))
    if tried[best]["executed"] == 0:
        where = "on any table of studies.execution.side_m: move its base (base_x, base_y_m) or list a smaller table"
        raise InputError(f"the arm executes no demonstration {where}")
    bench = benches[best]
    return bench, mapped(study, bench, study.lattice), pd.DataFrame(tried).assign(chosen=np.arange(len(tried)) == best)


def mapped(study: Any, bench: Bench, side: int) -> PostureMap:
    """Return a map of postures of `side` points a side, above the tallest item."""
    return posture_map(arm_of(study), bench, side, bench.side_m * max(study.item_heights_m.values()))


def judge(study: Any, points: Float[Array, "path instant 2"], bench: Bench) -> dict[str, Any]:
    """Return the placement with the shares of demonstrations that are executed and that fail, by name."""
    worst = mapped(study, bench, study.coarse).worst(points)
    row = {"side_m": bench.side_m, "base_x_m": bench.base_x, "base_y_m": bench.base_y}
    return row | {FAILURES[status] or "executed": float((worst == status).mean()) for status in range(3)}


def all_paths(cfg: DictConfig, scenes: SceneSet, demos: pd.DataFrame) -> pd.DataFrame:
    """Return a row a path with COLUMNS: repairs by gradient steps and search, the oracle, unrepaired random paths,
    the straight path, and demonstrations in their training scenes.

    accepted: by the model; true where there is none. valid: by the truth.
    """
    pool, first = cfg.protocol.splits[cfg.repair.split], cfg.protocol.seeds[0]
    repairs = read_table(Path(cfg.paths.repair) / "repairs.parquet").rename(columns={"valid_end": "valid"})
    repairs = repairs.assign(pool=pool, variant=repairs["variant"].fillna(""))
    repairs["accepted"] = repairs["accepted"].astype("boolean").fillna(True).astype(bool)
    oracle = (repairs["method"] == ORACLE) & (repairs["seed"] == first)  # the same for all seeds
    given = demos.assign(method=DEMONSTRATIONS, variant="", accepted=True, start=demos["demo"])
    parts = [repairs[repairs["method"].isin(REPAIRS) | oracle], given.assign(pool=[*map(train_pool, demos["seed"])])]
    layouts = scenes.layouts[pool]
    drawn = random_z_theta(stream(cfg.scenes.root_seed, "repair", "starts"), len(layouts), cfg.repair.starts)
    middle = np.broadcast_to((P_INIT + P_F) / 2, (len(layouts), 1, 2))
    for method, z in ((UNREPAIRED, drawn), (STRAIGHT, middle)):
        scene, start = (index.ravel() for index in np.indices(z.shape[:2]))
        for user, margins in cfg.users.items():
            row = {"method": method, "variant": "", "user": user, "seed": first, "pool": pool, "accepted": True}
            part = pd.DataFrame({"scene": scene, "start": start, "valid": valid(layouts, z, margins).ravel()})
            parts.append(part.assign(**row, z_x=z[..., 0].ravel(), z_y=z[..., 1].ravel()))
    return pd.concat([part[COLUMNS] for part in parts], ignore_index=True)


def executed(work: Work, z_theta: Float[Array, "path 2"]) -> pd.DataFrame:
    """Return a row a path: how it was executed."""
    return work.run(z_theta).results


def summary(executions: pd.DataFrame) -> pd.DataFrame:
    """Return a row for each method, and for `repairs`, both kinds together: its accepted paths.

    executed and failures: shares of accepted paths.
    """
    repairs = executions[executions["method"].isin(REPAIRS)].assign(method="repairs")
    accepted = pd.concat([executions, repairs]).query("accepted")
    groups = accepted.groupby("method", sort=False)
    failures = pd.crosstab(accepted["method"], accepted["failure"], normalize="index")
    shares = failures.reindex(columns=FAILURES, fill_value=0.0).rename(columns={"": "executed"})
    main_failure = shares[[*FAILURES[1:]]].idxmax(axis=1).where(shares["executed"] < 1, "–")
    table = groups.size().to_frame("accepted").join(shares).assign(main_failure=main_failure)
    means = groups[["error_mean_m", "duration_s"]].mean()
    return table.assign(error_mean_mm=1e3 * means["error_mean_m"], duration_s=means["duration_s"]).reset_index()


def simulated_paths(cfg: DictConfig, paths: pd.DataFrame) -> pd.DataFrame:
    """Return the paths that are simulated: the first random ones of each scene, for each user and repair.

    A path that is valid to the user is carried out as it is; a repaired one otherwise. Method "unrepaired": all as
    they are.
    """
    few = paths[(paths["start"] < cfg.studies.execution.physics_starts) & (paths["seed"] == cfg.protocol.seeds[0])]
    as_drawn = few[few["method"] == UNREPAIRED]
    parts = [as_drawn]
    for method, variant in ((m, v) for m, variants in cfg.studies.execution.physics.items() for v in variants):
        repaired = few[(few["method"] == method) & (few["variant"] == variant)]
        kept = as_drawn[as_drawn["valid"] & as_drawn["user"].isin(repaired["user"].unique())]
        parts += [kept.assign(method=method, variant=variant), repaired]
    return pd.concat(parts, ignore_index=True).sort_values([*GROUP, "scene", "start"], ignore_index=True)


def push(work: Work, job: Job) -> pd.DataFrame:
    """Return a row an execution: numbers of items touched and fallen."""
    z_theta, layouts = job
    motion, held, rows = work.run(z_theta), work.study.shaker, []
    parts = Part(0.0, 0.0, held.radius_m, held.below_m, held.above_m), gripper_of(arm_of(work.study))
    sizes = work.bench.side_m, work.study.item_heights_m, work.study.item_masses_kg
    for i, duration in enumerate(motion.results["duration_s"]):
        met, tilted = simulate(layouts, i, *sizes, parts, motion.grip[i], motion.heading[i], duration)
        rows.append({"touched": met.sum(), "fallen": (tilted > work.study.fallen_rad).sum()})
    return pd.DataFrame(rows)


def touched(physics: pd.DataFrame) -> pd.DataFrame:
    """Return, for each method, variant and user, executions and the shares with items touched or fallen.

    touched, touched_valid: numbers of executions, and of those of truly valid paths, in which an item is touched.
    """
    met = physics.assign(touched=physics["touched"] > 0, fallen=physics["fallen"] > 0)
    groups = met.assign(touched_valid=met["touched"] & met["valid"]).groupby(GROUP, sort=False)
    columns = {"executions": ("touched", "size"), "touched": ("touched", "sum")}
    columns |= {f"{name}_share": (name, "mean") for name in ("touched", "fallen")}
    columns |= {"valid": ("valid", "mean"), "touched_valid": ("touched_valid", "sum")}
    return groups.agg(**columns).reset_index()


def shown(work: Work, repaired: pd.DataFrame, paths: pd.DataFrame, images: Array) -> dict[str, np.ndarray]:
    """Return what the picture shows of one path before its repair and after it (first axis of z_theta and chain).

    chain (path, instant, joint, 3): places of joints and grip [m] in the table's frame, z above its top.
    """
    after = repaired[repaired["scene"] >= work.study.shown_scene].iloc[0]
    drawn = paths[(paths["method"] == UNREPAIRED) & (paths["user"] == after["user"])]
    before = drawn[(drawn["scene"] == after["scene"]) & (drawn["start"] == after["start"])].iloc[0]
    z_theta = np.array([[row["z_x"], row["z_y"]] for row in (before, after)], float)
    picture = {"image": images[int(after["scene"])], "side_m": np.array(work.bench.side_m)}
    return picture | {"z_theta": z_theta, "chain": work.run(z_theta).chain}
