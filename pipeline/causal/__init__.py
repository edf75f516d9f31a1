"""The structural causal model, interventions on it, and statistics of their effects."""
