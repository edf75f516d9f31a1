"""Sweeps: many settings of the graph's parameters by Hydra's launchers, stages shared through DVC's cache."""
