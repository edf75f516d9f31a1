"""Planning: gradient repair, the nearest valid path, the oracle."""
