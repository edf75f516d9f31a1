"""The inverse reinforcement learning baseline: a reward map integrated along the path."""
