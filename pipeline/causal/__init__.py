"""The structural causal model, interventions on it, and the statistics that judge them."""
