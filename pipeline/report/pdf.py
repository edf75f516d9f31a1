"""Turn every figure of the pages into a PDF by headless Chromium: `python -m pipeline.report.pdf` or `make figures`."""

import argparse
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from pipeline.runtime.errors import InputError

OUT, FOLDERS = Path("pdf"), ("reports/figures", "studies/*/figures")
CHROMIUM = ["--headless", "--no-sandbox", "--disable-gpu", "--no-pdf-header-footer"]
PAGE = """<style>@page {{ size: {0}pt {1}pt; margin: 0 }} body {{ margin: 0 }}</style>
<img src="{2}" style="display: block; height: 99.9vh">"""


def write_pdf(figure: Path, out: Path) -> None:
    """Write one SVG figure as a PDF page of its size; raise InputError if Chromium is missing."""
    browser = shutil.which("chromium")
    if browser is None:
        raise InputError("chromium is missing: apt-get install chromium")
    [size] = re.findall(r'viewBox="0 0 ([\d.]+) ([\d.]+)"', figure.read_text())
    out.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        page = Path(folder) / "page.html"
        page.write_text(PAGE.format(*size, figure.resolve().as_uri()))
        subprocess.run([browser, *CHROMIUM, f"--print-to-pdf={out}", page.as_uri()], check=True, capture_output=True)


if __name__ == "__main__":
    argparse.ArgumentParser(prog="python -m pipeline.report.pdf", description=__doc__).parse_args()
    try:
        for figure in sorted(path for folder in FOLDERS for path in Path().glob(f"{folder}/*.svg")):
            write_pdf(figure, OUT / figure.parent.parent / f"{figure.stem}.pdf")
    except InputError as error:
        sys.exit(f"error: {error}")
