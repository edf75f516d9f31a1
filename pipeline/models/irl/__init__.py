"""The inverse-reinforcement-learning baseline: a reward map sampled along the path."""
