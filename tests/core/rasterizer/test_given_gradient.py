"""A gradient that is given goes through autograd, without what torch would import for it."""

from __future__ import annotations

import subprocess
import sys

import torch
from dgs.core.rasterizer import with_gradient

STEP = """
import sys, torch
import run_dgs
run_dgs.mount_package()
from dgs.core.training.warmup import compile_kernels
compile_kernels(0)
print("sympy" in sys.modules)
"""


def test_the_gradient_arrives() -> None:
    leaf = torch.arange(6.0).reshape(2, 3).requires_grad_()
    wanted = torch.tensor([[1.0, -2.0, 0.5], [0.0, 3.0, 4.0]])
    with_gradient(leaf * 2.0, wanted).backward()
    assert torch.equal(leaf.grad, 2.0 * wanted)


def test_a_step_of_training_does_not_import_sympy() -> None:
    import dgs

    done = subprocess.run(
        [sys.executable, "-c", STEP], cwd=dgs.__path__[0], capture_output=True, text=True, timeout=120, check=True
    )
    assert done.stdout.strip() == "False"
