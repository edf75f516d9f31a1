"""Square roots do not depend on the processor."""

import ast
from pathlib import Path

import numpy as np
import torch

from pipeline.runtime.roots import square_root

ROOT = Path(__file__).resolve().parents[2]
EXACT = {"np", "numpy", "math"}  # their roots are the processor's, which IEEE 754 defines


def test_a_square_root_is_right_to_rounding_and_has_the_right_gradient():
    x = torch.rand(10_000, dtype=torch.float32).mul(100).add(1e-6).requires_grad_()
    root = square_root(x)
    np.testing.assert_allclose(root.detach().numpy(), np.sqrt(x.detach().numpy()), rtol=3e-7)
    root.sum().backward()
    np.testing.assert_allclose(x.grad.numpy(), 0.5 / np.sqrt(x.detach().numpy()), rtol=1e-6)  # pyright: ignore
    assert square_root(torch.zeros(3)).tolist() == [0, 0, 0]


def test_no_stage_asks_torch_for_a_square_root():
    found = []
    for path in [*ROOT.glob("pipeline/**/*.py"), *ROOT.glob("studies/**/*.py")]:
        called = (x for x in ast.walk(ast.parse(path.read_text())) if isinstance(x, ast.Attribute))
        roots = (x for x in called if x.attr in ("sqrt", "sqrt_") and ast.unparse(x.value) not in EXACT)
        found += [f"{path.relative_to(ROOT)}:{x.lineno}" for x in roots]
    assert not found, "torch's sqrt differs between makes of processor: use pipeline.runtime.roots.square_root"
