"""Report on a folder with photographs of a table and people's judged paths (docs/own-tables.md).

python -m pipeline.own FOLDER           check the folder, fit a model to each user, write FOLDER/report/index.html
python -m pipeline.own check FOLDER     only explain what is wrong with it
python -m pipeline.own record FOLDER    a local page on which people draw paths and judge them
"""

import shutil
import sys
import time
from pathlib import Path

from pipeline.runtime.errors import InputError

REPORT, KEPT = "report", ".models"  # folders that a run makes: the report, and models until it is done
VERBS = ("run", "check")


def main(arguments: list[str]) -> int:
    """Run one command; return 0, 1 if the folder has faults, 2 for a wrong command."""
    if arguments[:1] == ["record"]:
        from pipeline.own.recorder.serve import main as record

        return record(arguments[1:])
    if {"-h", "--help"} & set(arguments) or not arguments:
        print(__doc__)
        return 0 if arguments else 2
    verb = arguments.pop(0) if arguments[0] in VERBS and len(arguments) > 1 else "run"
    if len(arguments) != 1:
        print(f"error: got {' '.join(arguments)}: expected one folder; see --help", file=sys.stderr)
        return 2
    return run(Path(arguments[0]), only_check=verb == "check")


def run(path: Path, only_check: bool = False) -> int:
    """Check a folder and, unless that is all, write its report; return 0, or 1 if it has faults."""
    from pipeline.own.check import check  # torch and the models take seconds to import: the recorder needs none of it
    from pipeline.own.report import write_report
    from pipeline.own.results import compute
    from pipeline.runtime.parallel import one_thread

    one_thread()
    folder, demos, faults = check(path)
    for fault in faults:
        print(f"error: {fault}", file=sys.stderr)
    if folder is None:
        print(f"{len(faults)} faults in {path}: correct them and check again", file=sys.stderr)
        return 1
    for note in folder.notes:
        print(f"note: {note}")
    print(f"{path}: {len(folder.canvases)} scenes, {len(demos)} demonstrations of {', '.join(folder.users)}; no fault")
    if only_check:
        return 0
    begin = time.monotonic()

    def progress(step: str) -> None:
        print(f"{time.monotonic() - begin:4.0f} s  {step}", flush=True)

    results = compute(folder, demos, path / KEPT, progress)
    write_report(results, path / REPORT)
    shutil.rmtree(path / KEPT, ignore_errors=True)
    progress(f"wrote {path / REPORT / 'index.html'}")
    return 0


if __name__ == "__main__":
    try:
        sys.exit(main(sys.argv[1:]))
    except (InputError, OSError) as error:
        print(f"error: {' '.join(str(error).split())}", file=sys.stderr)
        sys.exit(2)
    except KeyboardInterrupt:
        print("interrupted: the next run goes on from here", file=sys.stderr)
        sys.exit(130)
