"""Text is UTF-8, devices' random state is the caller's, and a terminal is sent nothing that it lacks."""

import ast
import subprocess
import sys

import pytest

from pipeline.runtime.places import ROOT

LATIN = {"PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0", "LC_ALL": "C", "PYTHONPATH": str(ROOT)}
CALLS = [
    (path, node)
    for folder in ("pipeline", "studies", "making", "bench")
    for path in (ROOT / folder).rglob("*.py")
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
    if isinstance(node, ast.Call)
]


def names_its_encoding(call: ast.Call) -> bool:
    """Whether a call that reads or writes text says `encoding`; true of all others."""
    name = call.func.attr if isinstance(call.func, ast.Attribute) else getattr(call.func, "id", "")
    given = {keyword.arg: ast.unparse(keyword.value) for keyword in call.keywords}
    modes = {argument.value for argument in call.args if isinstance(argument, ast.Constant)}
    texts = name in ("read_text", "write_text") or (given.get("text") == "True" and name in ("run", "Popen"))
    texts |= name in ("open", "NamedTemporaryFile", "TemporaryFile") and not modes.isdisjoint({"r", "w", "a", "x"})
    return "encoding" in given or not texts


def test_all_code_names_the_encoding_of_text():
    assert [f"{path}:{call.lineno}" for path, call in CALLS if not names_its_encoding(call)] == []


def test_no_code_seeds_the_generators_of_all_devices():
    """Those of GPUs are the caller's; models draw from the processor's, which is put back."""
    seeding = [path for path, call in CALLS if ast.unparse(call.func) == "torch.manual_seed"]
    assert [path for path in seeding if path.is_relative_to(ROOT / "pipeline")] == []


@pytest.mark.parametrize("end", [r"print('\xfc')", r"raise InputError('\xfc')"])
def test_what_a_terminal_lacks_is_replaced(end: str):
    code = f"from pipeline.runtime.errors import InputError, reported\nwith reported(): {end}"
    ended = subprocess.run([sys.executable, "-c", code], env=LATIN, capture_output=True, encoding="ascii")
    assert (ended.returncode, ended.stdout + ended.stderr) in [(0, "?\n"), (2, "error: ?\n")]


@pytest.mark.slow
def test_commands_speak_to_a_terminal_that_lacks_letters():
    """The example's users are Ana and Jürgen."""
    command = [sys.executable, "-m", "pipeline.own", "check", "examples/table"]
    ended = subprocess.run(command, cwd=ROOT, env=LATIN, capture_output=True, encoding="ascii")
    assert ended.returncode == 0 and "Ana, J?rgen; no fault" in ended.stdout
