"""The command `specs`: one door to what stands behind `python -m`.

specs report FOLDER        fit a model to each person of a folder and write FOLDER/report/index.html
specs check FOLDER         say what is wrong with a folder, and draw what is seen in its pictures
specs record FOLDER        a local page on which people outline items, draw paths and judge them
specs ask FOLDER           a local page that tries on a person what they react to
specs import LOG FOLDER    make a folder of a robot's log
specs sweep ...            run the paper's graph with other settings (docs/sweeps.md)
specs audit ...            compare code, locks, pages and tables of a commit (docs/audit.md)
specs review ...           open recordings in Rerun's viewer (docs/review.md)

specs VERB --help          says more; specs --version
eval "$(specs --completion bash)"    the shell completes verbs; also zsh
"""

import runpy
import sys
from pathlib import Path

from pipeline import __version__
from pipeline.runtime.places import ROOT

OWN = ("report", "check", "record", "ask", "import")  # verbs of a person's own table
MODULES = dict.fromkeys(OWN, "pipeline.own") | {
    "sweep": "pipeline.sweep", "audit": "pipeline.audit", "review": "pipeline.viewer.review",
}  # fmt: skip
COMPLETION = {
    "bash": "complete -o default -W '{verbs}' specs",
    "zsh": 'compdef \'_arguments "1:verb:({verbs})" "*:file:_files"\' specs',
}


def main() -> int:
    """Run one verb; return 0, or 2 for a wrong command; a verb exits with its own status."""
    verb, *rest = sys.argv[1:] or ["--help"]
    if verb in MODULES:
        place = Path() if verb == "review" else ROOT
        if verb in OWN and verb != "report":
            rest = [verb, *rest]
        elif verb not in OWN and not (place / "dvc.yaml").is_file() and not {"-h", "--help"} & {*rest}:
            sys.exit(f"error: specs {verb} works in a clone of the repository, in the environment of its `make venv`")
        sys.argv = [f"specs {verb}", *rest]
        try:
            runpy.run_module(MODULES[verb], run_name="__main__", alter_sys=True)
        except ModuleNotFoundError as error:
            need = f"{error.name}: pip install 'causal-specifications[pipeline]'"
            sys.exit(f"error: specs {verb} needs {need}")
        return 0
    if verb == "--version":
        print(__version__)
    elif verb == "--completion" and rest in (["bash"], ["zsh"]):
        print(COMPLETION[rest[0]].format(verbs=" ".join(MODULES)))
    elif verb in ("-h", "--help"):
        print(__doc__)
    else:
        print(f"error: {' '.join(sys.argv[1:])!r}: expected {', '.join(MODULES)}; see specs --help", file=sys.stderr)
        return 2
    return 0
