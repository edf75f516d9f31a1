"""Learn specifications from demonstrations, and ask the fitted models causal questions.

The library interface is `fit`, `repair`, `effect`, `save` and `load` (pipeline.library); a fitted model predicts by
`model.probability(images, z_theta)`. These names are imported on first use, so that `import pipeline.params` is fast.
"""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pipeline.library import Effect, effect, fit, load, repair, save

__version__ = "3.0.0"
__all__ = ["Effect", "effect", "fit", "load", "repair", "save"]


def __getattr__(name: str) -> Any:
    """Import the library interface on first use."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    import torch

    dtype = torch.get_default_dtype()
    torch.set_default_dtype(torch.float32)  # tensors that modules make are no part of the caller's state
    try:
        with torch.inference_mode(False), torch.device("cpu"):
            from pipeline import library
    finally:
        torch.set_default_dtype(dtype)
    return getattr(library, name)
