"""Stage execution: the PR2's right arm carries out the repaired paths, joint by joint and in a simulation of physics.

What needs the extra `robot` is imported where it is used, so that settings are read without it.
"""

import shutil
from dataclasses import dataclass
from functools import partial
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import pandas as pd
from jaxtyping import Float
from numpy import ndarray as Array
from omegaconf import DictConfig
from pydantic import AfterValidator, Field

from pipeline.artifacts.demos import read_demos
from pipeline.artifacts.files import read_table, write_arrays, write_table
from pipeline.artifacts.scenes import SceneSet, read_scenes, train_pool
from pipeline.launch import launch
from pipeline.runtime.errors import InputError
from pipeline.runtime.parallel import map_jobs
from pipeline.runtime.settings import Count, Group, Length, Several, StudyGroup, Whole, need, need_some, rising
from pipeline.runtime.streams import stream
from pipeline.world.bezier import P_F, P_INIT, random_z_theta
from pipeline.world.layout import SYMBOLS, Layouts, concatenated
from pipeline.world.rules import valid

if TYPE_CHECKING:
    from pipeline.robot.arm import Arm, Bench
    from pipeline.robot.carried import Part
    from pipeline.robot.execution import Motion
    from pipeline.robot.inverse import PostureMap

KEY = ["pool", "scene", "z_x", "z_y"]  # what an execution depends on
GROUP = ["method", "variant", "user"]
COLUMNS = [*GROUP, "seed", *KEY[:2], "start", *KEY[2:], "accepted", "valid"]
REPAIRS = "gradient", "nearest"  # methods of stage repair that have a model
UNREPAIRED, STRAIGHT, ORACLE, DEMONSTRATIONS = "unrepaired", "straight", "oracle", "demonstrations"
ALL = "all"  # variants or users of a row of the summary
CLOSE = 0.05  # quantile of clearances in the summary
PUSHED = 50  # simulated executions of one job
Numbers = Annotated[list[float], Field(min_length=1)]
Job = tuple[Float[Array, "path 2"], Layouts]  # paths, each with its scene


class Shaker(Group):
    radius_m: Length
    below_m: Length
    above_m: Length


class Settings(StudyGroup):
    still: dict[str, float]
    posture: dict[str, float]
    height_m: float
    side_m: Annotated[list[Length], AfterValidator(rising)]
    base_x: Numbers
    base_y_m: Numbers
    grip_m: Length
    shaker: Shaker
    item_heights_m: dict[str, Length]
    item_masses_kg: dict[str, Length]
    coarse: Several
    lattice: Several
    instants: Several
    error_m: Length
    tilt_rad: Length
    physics_starts: Count
    physics: dict[str, list[str]]
    fallen_rad: Length
    shown_scene: Whole
    exported: Count
    chunk: Count


def agree(study: Settings, parameters: Any) -> None:
    """Require sizes for every symbol, known variants, starts that exist, and a shaker above the table."""
    name, starts, scenes = "studies.execution", parameters.repair.starts, parameters.scenes.shared
    for part, sizes in (("item_heights_m", study.item_heights_m), ("item_masses_kg", study.item_masses_kg)):
        need(set(sizes) == set(SYMBOLS), f"{name}.{part}", sorted(sizes), f"one of each of {', '.join(SYMBOLS)}")
    need_some(f"{name}.physics", study.physics, REPAIRS)
    for method, variants in study.physics.items():
        need_some(f"{name}.physics.{method}", variants, parameters.variants)
    most = f"at most repair.starts = {starts}"
    need(study.physics_starts <= starts, f"{name}.physics_starts", study.physics_starts, most)
    need(study.shown_scene < scenes, f"{name}.shown_scene", study.shown_scene, f"less than scenes.shared = {scenes}")
    below = study.shaker.below_m
    need(below < study.grip_m, f"{name}.shaker.below_m", below, f"less than {name}.grip_m = {study.grip_m}")


@dataclass(frozen=True)
class Work:
    """The arm in its place, with all that its executions share."""

    study: Any
    bench: "Bench"
    postures: "PostureMap"
    speed_m_s: float  # mean speed of the grip

    def run(self, z_theta: Float[Array, "path 2"]) -> "Motion":
        """Carry out paths."""
        from pipeline.robot.execution import execute

        study, placed = self.study, (arm_of(self.study), self.bench, self.postures)
        return execute(*placed, z_theta, study.instants, self.speed_m_s, study.error_m, study.tilt_rad)

    def parts(self) -> "tuple[Part, Part]":
        """Return the shaker and the gripper."""
        from pipeline.robot.carried import Part, gripper_of

        shaker = self.study.shaker
        return Part(0.0, 0.0, shaker.radius_m, shaker.below_m, shaker.above_m), gripper_of(arm_of(self.study))


def arm_of(study: Any) -> "Arm":
    """Return the arm, loaded once in each process."""
    from pipeline.robot.arm import load_arm

    return load_arm(tuple(study.posture.items()), tuple(study.still.items()))


def main(cfg: DictConfig, out_dir: Path) -> None:
    """Write placement.csv, executions.parquet, summary.csv, physics.parquet, touched.csv, shown.npz and the ROS 2
    bag `bag`. Raise InputError if a package of the extra `robot` is missing.
    """
    try:
        from pipeline.robot.execution import lengths, write_bag
    except ModuleNotFoundError as error:
        raise InputError(f"the robot needs {error.name}: run `pip install .[robot]`") from error

    study, pool, first = cfg.studies.execution, cfg.protocol.splits[cfg.repair.split], cfg.protocol.seeds[0]
    scenes, demos = read_scenes(Path(cfg.paths.scenes)), read_demos(Path(cfg.paths.demos))
    scenes.check_has(pool, *map(train_pool, cfg.protocol.seeds))
    speed = float((lengths(demos[["z_x", "z_y"]].to_numpy()) / demos["duration_s"]).median())
    bench, postures, tried = place(study, demos[demos["seed"] == first][["z_x", "z_y"]].to_numpy(), cfg.workers)
    work = Work(study, bench, postures, speed)
    write_table(out_dir / "placement.csv", tried.assign(speed_m_s=speed))

    paths = all_paths(cfg, scenes, demos)
    keys = paths[KEY].drop_duplicates(ignore_index=True).sort_values(KEY, ignore_index=True)
    layouts, offsets = concatenated(list(scenes.layouts.values())), np.cumsum([0, *map(len, scenes.layouts.values())])
    scene = offsets[[list(scenes.layouts).index(name) for name in keys["pool"]]] + keys["scene"].to_numpy()
    chunks = [slice(i, i + study.chunk) for i in range(0, len(keys), study.chunk)]
    jobs = [(keys.loc[keys.index[chunk], ["z_x", "z_y"]].to_numpy(), layouts[scene[chunk]]) for chunk in chunks]
    results = pd.concat(map_jobs(partial(carry_out, work), jobs, cfg.workers, "the arm carries out"), ignore_index=True)
    executions = paths.merge(pd.concat([keys, results], axis=1), on=KEY, how="left")
    write_table(out_dir / "executions.parquet", executions)
    write_table(out_dir / "summary.csv", summary(executions))

    chosen = simulated_paths(cfg, paths)
    parts = [part for _, part in chosen.groupby(chosen.index // PUSHED)]
    jobs = [(part[["z_x", "z_y"]].to_numpy(), scenes.layouts[pool][part["scene"].to_numpy()]) for part in parts]
    outcomes = pd.concat(map_jobs(partial(push, work), jobs, cfg.workers, "physics"), ignore_index=True)
    physics = pd.concat([chosen, outcomes], axis=1)
    write_table(out_dir / "physics.parquet", physics)
    write_table(out_dir / "touched.csv", touched(physics))

    method, variants = list(study.physics.items())[-1]
    mine = (paths["method"] == method) & (paths["variant"] == variants[0]) & (paths["user"] == next(iter(cfg.users)))
    repaired = paths[mine & (paths["seed"] == first)]
    exported = repaired.head(study.exported)
    names = [f"scene{scene}_start{start}" for scene, start in zip(exported["scene"], exported["start"], strict=True)]
    motion = work.run(exported[["z_x", "z_y"]].to_numpy())
    moves = zip(motion.q, motion.results["duration_s"], strict=True)
    shutil.rmtree(out_dir / "bag", ignore_errors=True)
    write_bag(out_dir / "bag", arm_of(study), dict(zip(names, moves, strict=True)))
    write_arrays(out_dir / "shown.npz", shown(work, repaired, paths, scenes.images[pool]))


def place(study: Any, z_theta: Float[Array, "path 2"], workers: int) -> "tuple[Bench, PostureMap, pd.DataFrame]":
    """Return table and base, a fine map of postures, and a row for each placement tried.

    z_theta: the demonstrations that judge it, those left out that cross the table's edge. Sizes are tried from the
    largest down to the first at which some base executes every demonstration, and the base is the first such one. If
    there is no such size, the placement that executes most. Raise InputError if that is none.
    """
    from pipeline.robot.arm import Bench
    from pipeline.robot.execution import minimum_jerk

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


def mapped(study: Any, bench: "Bench", side: int) -> "PostureMap":
    """Return a map of postures of `side` points a side, above the tallest item."""
    from pipeline.robot.inverse import posture_map

    return posture_map(arm_of(study), bench, side, bench.side_m * max(study.item_heights_m.values()))


def judge(study: Any, points: Float[Array, "path instant 2"], bench: "Bench") -> dict[str, Any]:
    """Return the placement with the shares of demonstrations that are executed and that fail, by name."""
    from pipeline.robot.execution import FAILURES

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


def carry_out(work: Work, job: Job) -> pd.DataFrame:
    """Return a row a path: how it was executed, and the least clearance [m] of shaker and gripper from any item."""
    from pipeline.robot.carried import clearances

    z_theta, layouts = job
    motion, sizes = work.run(z_theta), (work.bench.side_m, work.study.item_heights_m)
    shaker, gripper = (clearances(part, motion.grip, motion.heading, layouts, *sizes).min(1) for part in work.parts())
    return motion.results.assign(shaker_m=shaker, gripper_m=gripper)


def summary(executions: pd.DataFrame) -> pd.DataFrame:
    """Return a row for each method, variant and user, and for each method with all of its paths (variant and user
    "all"); method "repairs": both kinds of repair.

    executed and failures: shares of accepted paths; touching: share of accepted paths on which shaker or gripper meets
    an item; valid, touching_valid: numbers of accepted paths that are truly valid, and of those that meet an item.
    """
    from pipeline.robot.execution import FAILURES

    together = executions.assign(variant=ALL, user=ALL)
    repairs = together[together["method"].isin(REPAIRS)].assign(method="repairs")
    rows = []
    for group, part in pd.concat([executions, together, repairs]).groupby(GROUP, sort=False):
        accepted = part[part["accepted"]]
        meets = accepted[["shaker_m", "gripper_m"]].min(axis=1)
        row: dict[str, Any] = dict(zip(GROUP, group, strict=True)) | {"paths": len(part), "accepted": len(accepted)}
        row |= {"valid": int(accepted["valid"].sum()), "touching_valid": int((meets[accepted["valid"]] < 0).sum())}
        if len(accepted):
            row |= {name or "executed": float((accepted["failure"] == name).mean()) for name in FAILURES}
            row |= {"main_failure": max(FAILURES[1:], key=row.__getitem__) if row["executed"] < 1 else "–"}
            row |= {"error_mean_mm": 1e3 * accepted["error_mean_m"].mean(), "duration_s": accepted["duration_s"].mean()}
            row |= {"clearance_mm": 1e3 * meets.quantile(CLOSE), "touching": float((meets < 0).mean())}
        rows.append(row)
    return pd.DataFrame(rows)


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
    from pipeline.robot.carried import simulate

    z_theta, layouts = job
    motion, parts, rows = work.run(z_theta), work.parts(), []
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


if __name__ == "__main__":
    launch(main, "execution")
