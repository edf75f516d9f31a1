"""Learning specifications from demonstrations, and asking the learned models causal questions."""
