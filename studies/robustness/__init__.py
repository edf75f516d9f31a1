"""Study: how well models judge paths where images, scenes or labels are worse than in training."""
