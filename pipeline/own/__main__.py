"""Report on a folder with photographs of a table and people's judged paths (docs/own-tables.md).

python -m pipeline.own FOLDER           check the folder, fit a model to each user, write FOLDER/report/index.html
python -m pipeline.own check FOLDER     only explain what is wrong with it
python -m pipeline.own record FOLDER    a local page on which people draw paths and judge them
python -m pipeline.own import LOG FOLDER    a new folder from a ROS bag, a LeRobot data set or a csv file
python -m pipeline.own ask FOLDER       a local page that asks people about paths with and without an item (docs/ask.md)
"""

import importlib
import sys
import time
from pathlib import Path

from pipeline.runtime.errors import reported

COMMANDS = {"record": "recorder.serve", "ask": "recorder.asking", "import": "importing.run"}


def main(arguments: list[str]) -> int:
    """Run one command; return 0, 1 if the folder has faults, 2 for a wrong command."""
    if arguments and arguments[0] in COMMANDS:
        return importlib.import_module(f"pipeline.own.{COMMANDS[arguments[0]]}").main(arguments[1:])
    if {"-h", "--help"} & set(arguments) or not arguments:
        print(__doc__)
        return 0 if arguments else 2
    verb = arguments.pop(0) if arguments[0] == "check" and len(arguments) > 1 else "run"
    if len(arguments) != 1:
        print(f"error: got {' '.join(arguments)}: expected one folder; see --help", file=sys.stderr)
        return 2

    # torch and the models take seconds to import: the commands above need none
    from pipeline.own.asked import given
    from pipeline.own.figures import draw_scenes
    from pipeline.own.folder import SHEET, read_folder
    from pipeline.own.report import check_replaceable, write_report
    from pipeline.own.results import compute
    from pipeline.runtime.parallel import one_thread
    from pipeline.runtime.writing import atomic_write

    one_thread()
    path, begin = Path(arguments[0]), time.monotonic()
    folder, faults = read_folder(path)
    for note in [*faults.notes, *(folder.notes if folder else [])]:
        print(f"note: {note}")
    for fault in faults:  # names of files may hold terminal codes
        print("error:", "".join(c if c.isprintable() else repr(c)[1:-1] for c in fault), file=sys.stderr)
    if folder is None:
        count = "one fault" if len(faults) == 1 else f"{len(faults)} faults"
        print(f"{count} in {path}: correct and check again", file=sys.stderr)
        return 1
    counts = f"{len(folder.scenes)} scenes, {len(folder.demos)} demonstrations of {', '.join(folder.users)}"
    print(f"{path}: {counts}; no fault")
    for line in folder.advice:
        print(line)
    if (answers := given(folder)).apart:
        print(f"{answers.apart} sittings of `ask` are kept apart: pictures, cut-outs or users have changed since")
    sheet = draw_scenes(folder, len(folder.scenes))
    atomic_write(path / SHEET, lambda part: sheet.savefig(part, format="png"))
    if verb == "check":
        return 0
    check_replaceable(out := path / "report")
    write_report(compute(folder, answers), out)
    print(f"wrote {out / 'index.html'} after {time.monotonic() - begin:.0f} s")
    return 0


if __name__ == "__main__":
    try:
        with reported(OSError):
            sys.exit(main(sys.argv[1:]))
    except ModuleNotFoundError as error:
        extra = "import" if "import" in sys.argv[1:2] else "own"
        sys.exit(f"error: this needs {error.name}: pip install 'causal-specifications[{extra}]'")
    except KeyboardInterrupt:
        print("interrupted: nothing was written", file=sys.stderr)
        sys.exit(130)
