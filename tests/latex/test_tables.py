"""The committed tables compile as they are, and fit the page they are made for."""

import re
import subprocess
from pathlib import Path

TABLES = Path(__file__).parent.parent.parent / "reports" / "tables"
PAPER = r"""\documentclass{article}
\usepackage[letterpaper,margin=1in]{geometry}
\usepackage{booktabs}
\begin{document}
%s
\end{document}
"""


def test_every_table_compiles_and_fits_a_page(tmp_path: Path):
    tables = [path.read_text(encoding="utf-8") for path in sorted(TABLES.glob("*.tex"))]
    assert tables
    (tmp_path / "paper.tex").write_text(PAPER % "\n\\clearpage\n".join(tables), encoding="utf-8")
    command = ["pdflatex", "-interaction=nonstopmode", "-halt-on-error", "paper.tex"]
    said = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, errors="replace")
    assert said.returncode == 0, said.stdout[-2000:]
    assert re.findall(r"Overfull .*|Float too large.*", said.stdout) == []
