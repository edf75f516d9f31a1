"""Study: whether users’ solutions cluster, overlap and vary."""
