"""Let libraries use the same instructions on every x86-64 processor with AVX2, so that sums are rounded alike."""

import os
import platform

SETTINGS = {
    "ATEN_CPU_CAPABILITY": "avx2",  # torch's own kernels
    "ONEDNN_MAX_CPU_ISA": "AVX2",  # torch's convolutions
    "MKL_CBWR": "COMPATIBLE",  # torch's products of matrices; the only mode that Intel promises for all makes
    "OPENBLAS_CORETYPE": "Haswell",  # products of matrices in numpy and scipy
    "NPY_DISABLE_CPU_FEATURES": "X86_V4 AVX512_ICL AVX512_SPR",  # numpy's loops: AVX2 is left
}


def fix_instructions() -> None:
    """Set the variables that libraries read when they are imported; those of the caller's environment win."""
    if platform.machine() in ("x86_64", "AMD64"):
        for name, value in SETTINGS.items():
            os.environ.setdefault(name, value)
