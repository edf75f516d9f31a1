"""Find the repository's own files."""

from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
CONF = ROOT / "conf"
PARAMS = Path("params.yaml")  # in the current folder
PROCESSORS = Path("reports/processors.json")  # stage -> the processor on which DVC ran it last
