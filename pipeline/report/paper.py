"""The numbers the paper prints, to stand beside ours (its Table 2 comes with the world's metrics)."""

from typing import NamedTuple


class Spread(NamedTuple):
    """Mean and quartiles over the paper's 10 randomisations, as shares of 1."""

    mean: float
    q1: float
    q3: float


ACCURACY = {1: Spread(0.72, 0.673, 0.775), 9: Spread(0.99, 0.978, 0.998)}  # n -> Section "Model Accuracy"
REPAIR = {"careful": 0.75, "normal": 0.95, "aggressive": 1.00}  # Table "backprop"
BOLD = {("careful", s) for s in ("bowl", "plate", "cutlery", "glass")} | {("normal", "glass")}  # its Table 2
