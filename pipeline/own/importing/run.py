"""The command `import`: read logs, say how they were understood, and write a new folder, completely or not at all."""

import argparse
import json
import re
import shlex
import shutil
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from pydantic import ValidationError

from pipeline.own import files
from pipeline.own.files import DEMONSTRATIONS, KEY, SCENES, SETTINGS, Settings
from pipeline.own.importing import segments
from pipeline.own.importing.segments import Choices, Recording
from pipeline.runtime.errors import InputError
from pipeline.world.images import PNG_SIGNATURE, image_size

BAGS, TEXTS = (".mcap", ".db3", ".bag"), (".csv", ".tsv", ".txt")
VALID: dict[str, str] = {"": ""} | dict.fromkeys(("true", "yes", "good", "valid", "1", "1.0"), "true")  # of labels
VALID |= dict.fromkeys(("false", "no", "bad", "invalid", "0", "0.0"), "false")
HEADER = "# docs/own-tables.md says what each line is, docs/import.md what stands below `import`.\n"
Read = Callable[[Path, Choices], tuple[list[Recording], Choices, list[str]]]


def main(arguments: Sequence[str]) -> int:
    """Import logs as the command line says; return 0. Raise InputError, with nothing written, if one cannot be used."""
    parser = argparse.ArgumentParser("python -m pipeline.own import", "%(prog)s [options] LOG [LOG ...] FOLDER")
    parser.description = "Make a folder from logs."
    parser.add_argument("logs", type=Path, nargs="+", metavar="LOG", help="ROS bag, LeRobot data set or csv file")
    parser.add_argument("folder", type=Path, metavar="FOLDER", help="new, or with table.yaml alone, which then holds")
    parser.add_argument("--topic", help="of the poses, in a bag")
    parser.add_argument("--hand", metavar="FRAME", help="TF frame that moves, instead of a topic")
    parser.add_argument("--frame", help="TF frame of the table: its near left corner, x right, y away from the person")
    parser.add_argument("--picture", help="topic or camera of the scenes' pictures")
    parser.add_argument("--gripper", help="topic, topic:joint or column; demonstrations are while it is closed")
    parser.add_argument("--label", help="topic or column of what the person accepts")
    parser.add_argument("--size", metavar="WIDTH,DEPTH", help="of the table [m]")
    parser.add_argument("--columns", metavar="x=NAME,y=NAME", help="t=, too, and in a csv file scene=, user=, demo=")
    parser.add_argument("--user", default="me", help="whose demonstrations they are, where the log names nobody")
    options = {name: value for name, value in vars(parser.parse_args(arguments)).items() if value is not None}
    logs, folder, user = options.pop("logs"), options.pop("folder").resolve(), options.pop("user")
    if "columns" in options:
        options["columns"] = dict(one.partition("=")[::2] for one in options["columns"].split(","))
        if wrong := options["columns"].keys() - {*"txy", *KEY}:
            raise InputError(f"--columns names {min(wrong)!r}: expected some of {', '.join([*'txy', *KEY])}")
    held = sorted(path.name for path in folder.iterdir()) if folder.is_dir() else []
    if (folder.exists() and not folder.is_dir()) or {*held} - {SETTINGS} or (held and "size" in options):
        what = f"{folder} holds {', '.join(held) or 'no folder'}"
        expected = f"a new folder, or one with {SETTINGS} alone and no --size"
        raise InputError(f"{what}: expected {expected}; move the rest away")
    settings, choices = _confirmed(folder, options)
    recordings, notes = list[Recording](), list[str]()
    for log in logs:
        read = _reader(log)
        with _readable(log):
            parts, choices, remarks = read(log, choices)
        recordings += parts
        notes += [f"{log}: {remark}" for remark in dict.fromkeys(remarks)]
    if not recordings:
        raise InputError("the logs hold no recording: expected at least one")
    for recording in recordings:
        segments.check_times(recording)
    middle, closed = segments.grip(recordings) if choices.gripper else (0.0, None)
    cuts = "gripper" if choices.gripper else "whole" if all(recording.whole for recording in recordings) else "stops"
    unit = choices.unit or segments.guess_unit(recordings)
    guesses = {"unit": unit, "y": "up", "segments": cuts, "closed": closed}
    guessed = {name: value for name, value in guesses.items() if value and getattr(choices, name) is None}
    choices = choices.model_copy(update=guessed)
    lines = [
        f"  {name}: {json.dumps(value, ensure_ascii=False)}{'  # guessed' if name in guessed else ''}\n"  # JSON is YAML
        for name, value in choices.model_dump(exclude_none=True).items()
    ]
    section = f"import:\n{''.join(lines)}"
    staged = next(one for one in folder.parents if one.is_dir()) / f".part-{folder.name}"
    shutil.rmtree(staged, ignore_errors=True)  # of a run that was killed
    try:
        (staged / SCENES).mkdir(parents=True)
        notes += _write(staged, recordings, choices, middle, settings, user)
        if not held:
            width, depth = settings.size_m
            text = f"{HEADER}size_m: [{width:g}, {depth:g}]  # width and depth of the table [m]\n{section}"
            (staged / SETTINGS).write_text(text, encoding="utf-8")
        folder.mkdir(parents=True, exist_ok=True)
        for path in sorted(staged.iterdir(), reverse=True):  # demonstrations.csv last
            path.rename(folder / path.name)
    except OSError as error:
        raise InputError(f"{folder} cannot be written ({error.strerror}): choose another folder") from error
    finally:
        shutil.rmtree(staged, ignore_errors=True)
    print(section, *(f"note: {note}\n" for note in notes), sep="", end="")
    print(f"{folder}: is a line above wrong? Put it right below `import` in {SETTINGS}, remove the rest, import again")
    verb = "record " if any("recorder" in note for note in notes) else ""
    print(f"next: python -m pipeline.own {verb}{shlex.quote(str(folder))}")
    return 0


def _reader(log: Path) -> Read:
    """Return what reads a log, by what it is; its libraries are imported only then."""
    if log.suffix in TEXTS and log.is_file():
        from pipeline.own.importing.text import read
    elif (log / "meta" / "info.json").is_file():
        from pipeline.own.importing.lerobot import read
    elif (log.suffix in BAGS and log.is_file()) or (log / "metadata.yaml").is_file():
        from pipeline.own.importing.bags import read
    else:
        cut_off = any(file.suffix in BAGS for file in log.glob("*"))
        other = "is of another kind" if log.exists() else "is missing"
        why = "has no metadata.yaml, which `ros2 bag reindex` writes" if cut_off else other
        kinds = f"a ROS bag (its folder, or {', '.join(BAGS)}), a LeRobot data set, or {', '.join(TEXTS)}"
        raise InputError(f"{log} {why}: expected {kinds}")
    return read


@contextmanager
def _readable(log: Path | str) -> Iterator[None]:
    """Raise InputError for whatever goes wrong in a foreign file: each library has its own kinds of errors."""
    try:
        yield
    except (InputError, ImportError):
        raise
    except Exception as error:
        why = "it is truncated, damaged, or stored in a way that is not supported"
        advice = "copy it again, or repair it (`mcap recover`, `ros2 bag reindex`, `git lfs pull`); see docs/import.md"
        said = " ".join(f"{type(error).__name__}: {error}".split())  # those of YAML have several lines
        raise InputError(f"{log} cannot be read ({said}): {why}; {advice}") from error


def _confirmed(folder: Path, options: dict[str, Any]) -> tuple[Settings, Choices]:
    """Return what table.yaml and then the command line say of the table and of the log."""
    content = files.read_content(folder)
    if "size" in options:
        width, *depth = options.pop("size").split(",")
        content["size_m"] = [width, *depth] if depth else width
    try:
        confirmed = Choices.model_validate(content.get("import") or {}).model_dump()
        for name, given in options.items():
            held = confirmed[name]
            if held is not None and given != held and not (name == "columns" and given.items() <= held.items()):
                what = f"--{name} says {given!r}, {SETTINGS} {held!r}"
                raise InputError(f"{what}: correct it there, or leave the option out")
        options |= {name: held for name, held in confirmed.items() if held is not None}
        return files.check_settings(content), Choices.model_validate(options)
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(map(str, ("import", *first["loc"])))
        raise InputError(f"{SETTINGS}: {place} is {first['input']!r}: {first['msg']}; correct it") from error


def _write(
    folder: Path, recordings: Sequence[Recording], choices: Choices, middle: float, settings: Settings, user: str
) -> list[str]:
    """Write pictures and demonstrations.csv into an empty folder; return remarks. InputError if nothing moves."""
    size = settings.size_m
    metres = [segments.on_table(recording.places, choices, size[1]) for recording in recordings]
    moves = [segments.cut(one, places, choices, middle) for one, places in zip(recordings, metres, strict=True)]
    runs = list(map(segments.without_ways_back, metres, moves)) if choices.segments == "stops" else moves
    returns = sum(map(len, moves)) - sum(map(len, runs))
    totals, numbers, tables, shown = Counter[str](), Counter[Any](), [], dict[str, bool | None]()
    made_by = dict[str, str]()  # the recording that a scene is named after
    for recording, parts in zip(recordings, runs, strict=True):
        totals[recording.name] += len(parts)
    if not totals.total():
        used = choices.model_dump_json(exclude_none=True)
        least = f"{segments.MIN_PATH_M:g} m"
        raise InputError(f"no movement is {least} long: correct unit, topic, columns or segments of {used}")
    for recording, places, parts in zip(recordings, metres, runs, strict=True):
        begins, name = [int(part[0]) for part in parts], recording.name
        with _readable(f"a picture of {name}"):
            for rows, picture, end in zip(parts, recording.pictures(begins), [*begins, np.inf][1:], strict=True):
                numbers[name] += 1
                base = f"{name}-{numbers[name]:02d}" if totals[name] > 1 else name
                tidy = re.sub(r"[^\w.-]+", "-", files.normal(base)).strip("-.")
                labels = {"scene": tidy, "user": user} | recording.labels
                scene = labels["scene"]
                if "scene" not in recording.labels and made_by.setdefault(scene, name) != name:
                    raise InputError(f"{made_by[scene]} and {name} both make the scene {scene}: rename one of the logs")
                for role, label in labels.items():
                    if not files.is_printable(label) or not label.strip() or (role == "scene" and {*label} & {*"/\\"}):
                        raise InputError(f"{role} is {label!r}: expected a name, of a file if it is the scene's")
                numbers[scene, labels["user"]] += 1
                word = ["", *(word for after, word in recording.words if rows[0] < after <= end)][-1]
                if word.lower() not in VALID:
                    expected = ", ".join(filter(None, VALID))
                    raise InputError(f"the label of {scene} is {word!r}: expected one of {expected}")
                labels = {"demo": str(numbers[scene, labels["user"]]), "valid": VALID[word.lower()]} | labels
                shown.setdefault(scene)
                if picture is not None:
                    ending = "png" if picture.startswith(PNG_SIGNATURE) else "jpg"
                    (path := folder / SCENES / f"{scene}.{ending}").write_bytes(picture)
                    shown[scene] = files.has_shape(*image_size(path), size)
                t, (x, y) = recording.t[rows] - recording.t[rows[0]], places[rows].T
                tables.append(pd.DataFrame({"t": t.round(3), "x": x.round(4), "y": y.round(4)}).assign(**labels))
    table = pd.concat(tables)[files.COLUMNS[DEMONSTRATIONS]]
    table.to_csv(folder / DEMONSTRATIONS, index=False, lineterminator="\n")
    (left, near), (right, far) = table[["x", "y"]].min(), table[["x", "y"]].max()
    notes = [f"demonstrations: {len(tables)}, x from {left:g} to {right:g} m, y from {near:g} to {far:g} m"]
    if min(left, near) < 0 or right > size[0] or far > size[1]:
        advice = "correct size_m, unit, origin, turn_deg or y"
        notes.append(f"these leave the table of {size[0]:g} by {size[1]:g} m: {advice}")
    if still := sum(not parts for parts in runs):
        notes.append(f"recordings without a demonstration of {segments.MIN_PATH_M:g} m, left out: {still}")
    if returns:
        notes.append(f"movements back to where the one before began, left out: {returns}; `segments: moves` keeps them")
    if min(right - left, far - near) < segments.REST_M:
        notes.append("x or y stays the same: choose the table's plane by --columns or --frame")
    if bare := [scene for scene, fits in shown.items() if fits is None]:
        notes.append(f"scenes without a picture: {len(bare)}; add {SCENES}/{min(bare)}.jpg, and so on")
    if settings.corners is None and False in shown.values():
        notes.append("the pictures show more than the table: mark its corners with the recorder")
    if unlabelled := len(table[table["valid"] == ""].drop_duplicates(KEY)):
        notes.append(f"demonstrations without a label: {unlabelled}; judge them with the recorder")
    return notes
