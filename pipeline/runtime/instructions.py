"""Let libraries use one thread, and the same instructions on every x86-64 processor with AVX2: sums round alike."""

import ctypes
import os
import platform

THREADS = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")  # torch, numpy, scipy
SETTINGS = {
    "ATEN_CPU_CAPABILITY": "avx2",  # torch's own kernels
    "ONEDNN_MAX_CPU_ISA": "AVX2",  # torch's convolutions
    "MKL_CBWR": "COMPATIBLE",  # torch's products of matrices; the only mode that Intel promises for all makes
    "OPENBLAS_CORETYPE": "Haswell",  # products of matrices in numpy and scipy
    "NPY_DISABLE_CPU_FEATURES": "X86_V4 AVX512_ICL AVX512_SPR",  # numpy's loops: AVX2 is left
}


def fix_instructions() -> None:
    """Set the variables that libraries read when they are imported; those of the caller's environment win."""
    x86 = platform.machine() in ("x86_64", "AMD64")
    for name, value in (THREADS | SETTINGS if x86 else THREADS).items():
        os.environ.setdefault(name, value)


def disable_malloc_trim() -> None:
    """Keep freed arrays in this process: zeroed pages from the kernel cost up to two thirds of the time."""
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)  # glibc only
    if mallopt is not None:
        mallopt(-3, 64 << 20)  # M_MMAP_THRESHOLD
        mallopt(-1, 512 << 20)  # M_TRIM_THRESHOLD
