"""Open recordings in Rerun's viewer, and note what was seen (docs/review.md)."""

import argparse
import os
import socket
import subprocess
import sys
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from urllib.parse import quote

import pandas as pd
from filelock import FileLock
from omegaconf import DictConfig
from rerun.catalog import CatalogClient, DatasetEntry

from pipeline.artifacts.files import read_table, write_table
from pipeline.git import environment, git
from pipeline.git import run as run_in
from pipeline.launch import load
from pipeline.runtime.errors import InputError, reported
from pipeline.runtime.places import PARAMS
from pipeline.runtime.reading import read_csv
from pipeline.viewer.catalog import RUNS, SCENES, catalog, facts_of_runs
from pipeline.viewer.compared import read_overview, write_comparison
from pipeline.viewer.digest import digest, worst_scenes
from pipeline.viewer.linked import Place, linked, place, served
from pipeline.viewer.run import OVERVIEW, REPAIR, SCENE, layout, overview_layout

COLUMNS = ["run", "sha256", "accuracy"]  # of recordings.csv
REVIEWED = Path("reports/reviewed.csv")  # with the digest of the recording that was looked at
REVIEWED_COLUMNS = ["run", "scene", "verdict", "note", "who", "when", "sha256"]
VERDICTS = "right", "wrong", "unclear"


def recordings(kept: Path, runs: Path) -> dict[str, Path]:
    """Return the recordings there are by name: those kept in git, or better those of stage record (`runs`)."""
    return {path.stem: path for folder in (kept, runs) for path in sorted(folder.glob("*.rrd"))}


def are_of_this_commit(kept: Path, runs: Path) -> bool:
    """Return whether stage record wrote `runs` with the table in git: a checkout changes that, and leaves `runs`."""
    written, table = runs / "recordings.csv", kept / "recordings.csv"
    return written.is_file() and table.is_file() and written.read_bytes() == table.read_bytes()


def find(kept: Path, runs: Path, run: str) -> Path:
    """Return the recording of `run`, or the overview; InputError if there is none."""
    here = recordings(kept, runs)
    if run not in here:
        known = (
            f"no recording {run!r} here, but {', '.join(list(here)[:5]) or 'none'}: expected <variant>-<user>-s<seed>"
        )
        raise InputError(f"{known}; git keeps few of them, `make repro` writes all")
    return here[run]


def worst(kept: Path, runs: Path) -> tuple[str, str]:
    """Return the run with the lowest accuracy of those there are, and a sentence that states this."""
    table = read_table(kept / "recordings.csv", COLUMNS).set_index("run")
    here = table.index.isin(recordings(kept, runs).keys() - {OVERVIEW})
    accuracy = pd.to_numeric(table["accuracy"][here], errors="coerce")
    if accuracy.empty or not accuracy.between(0, 1).all():
        raise InputError(f"{kept / 'recordings.csv'} gives no accuracy from 0 to 1 for every run: run `make repro`")
    run = str(accuracy.idxmin())
    return run, f"{run}: accuracy {accuracy[run]:.1%}, the lowest of the {len(accuracy)} recordings here"


def check(kept: Path, runs: Path, run: str) -> str:
    """Return a recording's digest; raise InputError unless Rerun can read it and recordings.csv has that digest."""
    path = find(kept, runs, run)
    expected = read_table(kept / "recordings.csv", COLUMNS).set_index("run")["sha256"].get(run)
    if expected != (contents := digest(path)):
        says = f"{path} has digest {contents}, recordings.csv says {expected}"
        raise InputError(f"{says}: delete its folder and run `make repro`")
    return contents


def reviewed() -> pd.DataFrame:
    """Return reviewed.csv, or no rows without one; InputError, with nothing lost, for anything but verdicts in it."""
    if not REVIEWED.is_file():
        return pd.DataFrame(columns=REVIEWED_COLUMNS).astype({"scene": "Int64"})
    try:
        table = read_csv(REVIEWED, REVIEWED_COLUMNS)[REVIEWED_COLUMNS]
        scenes = pd.to_numeric(table["scene"]).astype("Int64")
        wrong = table[~table["verdict"].isin(VERDICTS) | table[["run", "sha256"]].isna().any(axis=1)]
        if len(wrong):
            raise ValueError(f"a row is {wrong.iloc[0].dropna().tolist()}")
    except (OSError, ValueError, KeyError, TypeError) as error:
        kept = "after a merge keep the rows of both sides and take out git's marks"
        raise InputError(f"{REVIEWED} cannot be read ({error}): expected {REVIEWED_COLUMNS}; {kept}") from error
    return table.assign(scene=scenes)


def reviews(kept: Path) -> pd.DataFrame:
    """Return what was noted of recordings as they are now; a note on other contents than today's is left out."""
    table, digests = reviewed().fillna({"note": ""}), read_table(kept / "recordings.csv", COLUMNS)["sha256"]
    return table[table["sha256"].isin(digests)]


def note(kept: Path, runs: Path, run: str, verdict: str, scene: int | None, text: str) -> None:
    """Add a verdict on a run, or one of its worst scenes, to reviewed.csv and commit that file with git's user name.

    One reviewer's command waits for another's. Raises InputError, with the file as it was, if git does not commit it.
    """
    contents = check(kept, runs, run)
    if scene is not None and scene not in (scenes := worst_scenes(find(kept, runs, run))):
        raise InputError(f"scene {scene} is none of the worst of {run}: expected one of {scenes}, or no scene")
    who = git(Path(), "var", "GIT_AUTHOR_IDENT").partition(" <")[0]
    row = [run, scene, verdict, text, who, f"{datetime.now(UTC):%Y-%m-%d}", contents]
    with FileLock(git(Path(), "rev-parse", "--git-path", "reviewed.lock").strip()):
        old, before = reviewed(), REVIEWED.read_bytes() if REVIEWED.is_file() else None
        write_table(REVIEWED, pd.concat([old, pd.DataFrame([row], columns=REVIEWED_COLUMNS)]))
        is_new = not git(Path(), "ls-files", str(REVIEWED))
        try:
            git(Path(), "add", "--intent-to-add", str(REVIEWED))  # what the person staged of it stays if this fails
            git(Path(), "commit", "--quiet", "--message", f"Review of {run}: {verdict}", "--", str(REVIEWED))
        except InputError:
            REVIEWED.unlink() if before is None else REVIEWED.write_bytes(before)
            if is_new:
                run_in(["git", "reset", "--quiet", "--", str(REVIEWED)], Path(), capture_output=True)
            raise


def show_all(cfg: DictConfig, kept: Path, runs: Path, web: bool) -> int:
    """Open the catalog of all recordings there are, until the viewer is closed; return its exit code."""
    files = recordings(kept, runs)
    commit = run_in(["git", "rev-parse", "--short", "HEAD"], Path(), capture_output=True).stdout.strip()
    caring = [user for user, margins in cfg.users.items() if any(margin is not None for margin in margins.values())]
    layouts = {
        RUNS: layout(cfg.record.training_scenes),
        OVERVIEW: overview_layout(caring or [*cfg.users], len(cfg.variants)),
    }
    with catalog(files, layouts, reviews(kept), commit) as client:
        listed = read_table(kept / "recordings.csv", COLUMNS)
        unread = files.keys() - {*client.get_dataset(RUNS).segment_ids(), OVERVIEW}
        print(f"{len(files) - len(unread)} of {len(listed)} recordings; `make repro` writes all", flush=True)
        if unread:
            which = f"these cannot be read or hold another run: {', '.join(sorted(unread))}"
            print(f"{which}; delete their folder and run `make repro`", flush=True)
        entries = client.get_dataset(RUNS), client.get_table(SCENES)
        addresses = [f"{client.url}/entry/{entry.id}" for entry in entries]
        if not web:
            return show(addresses)
        page = free_port()
        with served(Path(), partial(linked_to, client, page)) as pages:
            print(f"open {pages}/reports/index.html for the pages, with links from numbers to recordings", flush=True)
            return show(addresses, web, page)


def linked_to(client: CatalogClient, port: int, page: str) -> str:
    """Return a page whose numbers and figures are links to recordings of the catalog, in the web viewer at `port`."""
    dataset, runs = client.get_dataset(RUNS), facts_of_runs(client)

    def address(found: Place, of: DatasetEntry = dataset) -> str:
        return f"http://127.0.0.1:{port}/?url={quote(of.segment_url(*found), safe='')}"

    figures = {}
    if runs:
        least = min(runs, key=lambda run: run["accuracy"])
        figures["make review WORST=1"] = address((least["run"], REPAIR, 0))
    if OVERVIEW in client.dataset_names():
        figures["make review"] = address((OVERVIEW, SCENE, 0), client.get_dataset(OVERVIEW))
    return linked(page, lambda facts: address(found) if (found := place(runs, facts)) else None, figures)


def show_between(kept: Path, commits: tuple[str, str], web: bool) -> int:
    """Open what the overviews of two commits show of the same models and scenes; return the viewer's exit code."""
    with TemporaryDirectory() as folder:
        maps = []
        for i, commit in enumerate(commits):
            name = f"{commit}:{(kept / OVERVIEW).as_posix()}.rrd"
            said = subprocess.run(["git", "show", name], env=environment(), capture_output=True)
            if said.returncode:
                reason = said.stderr.decode().strip()
                raise InputError(f"git has no {name}: expected two commits with an overview ({reason})")
            (Path(folder) / f"{i}.rrd").write_bytes(said.stdout)
            maps.append(read_overview(Path(folder) / f"{i}.rrd"))
        worse = write_comparison(Path(folder) / "compared.rrd", *maps)
        print(f"{worse} cells were right in {commits[0]} and are wrong in {commits[1]}", flush=True)
        return show([str(Path(folder) / "compared.rrd")], web)


def free_port() -> int:
    """Return a port of this machine that nobody uses."""
    with socket.create_server(("127.0.0.1", 0)) as one:
        return one.getsockname()[1]


def show(shown: list[str], web: bool = False, page: int = 0) -> int:
    """Open Rerun's viewer on files or addresses, for this machine only, until it is closed; return its exit code.

    page: the port of the web viewer; 0: any.
    """
    screen = sys.platform != "linux" or os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    if not (web or screen):
        raise InputError("no display to open a window on: expected WEB=1 (or --web) for a browser, or a display")
    command = [sys.executable, "-m", "rerun", "--bind", "127.0.0.1", *shown]
    if web:
        page, port = page or free_port(), free_port()
        command += ["--web-viewer" if screen else "--serve-web", "--web-viewer-port", f"{page}", "--port", f"{port}"]
        served = shown if "://" in shown[0] else [f"rerun+http://127.0.0.1:{port}/proxy"]
        query = "&".join("url=" + quote(address, safe="") for address in served)
        print(f"open http://127.0.0.1:{page}/?{query} in a browser; Ctrl-C stops", flush=True)
    try:
        return subprocess.run(command).returncode
    except KeyboardInterrupt:
        return 0


def _main() -> int:
    parser = argparse.ArgumentParser("python -m pipeline.viewer.review", description=__doc__)
    which = parser.add_mutually_exclusive_group()
    which.add_argument("run", nargs="?", default=OVERVIEW, help=f"<variant>-<user>-s<seed> (default: {OVERVIEW})")
    which.add_argument("--worst", action="store_true", help="the run with the lowest accuracy")
    which.add_argument("--all", action="store_true", help="tables of all runs and of their worst scenes")
    which.add_argument("--between", nargs=2, metavar=("A", "B"), help="overviews of two commits")
    parser.add_argument(
        "--verdict", choices=VERDICTS, help="add it to reports/reviewed.csv and commit that file; no window"
    )
    parser.add_argument("--scene", type=int, help="of the verdict: one scene of the run, not all of it")
    parser.add_argument("--note", default="", help="of the verdict: why")
    parser.add_argument("--web", action="store_true", help="serve Rerun's web viewer to this machine")
    parser.add_argument("--check", action="store_true", help="verify the file and compare its digest; no window")
    args = parser.parse_args()
    run, cfg = args.run, load(PARAMS)
    folders = kept, runs = Path(cfg.paths.record), Path(cfg.paths.runs)
    if runs.is_dir() and not are_of_this_commit(*folders):
        print(f"{runs} holds recordings of other results, left out: `make repro` writes today's", flush=True)
        folders = kept, kept
    if args.worst:
        run, reason = worst(*folders)
        print(reason, flush=True)
    if args.check:
        check(*folders, run)
        print(f"{run}: readable, and its digest is that of recordings.csv")
        return 0
    if args.verdict:
        note(*folders, run, args.verdict, args.scene, args.note)
        print(f"{run}: {args.verdict}, committed in {REVIEWED}")
        return 0
    if args.between:
        return show_between(folders[0], args.between, args.web)
    return show_all(cfg, *folders, args.web) if args.all else show([str(find(*folders, run))], args.web)


if __name__ == "__main__":
    with reported(OSError):
        sys.exit(_main())
