"""Planning: gradient repair, the nearest valid path and the oracle."""
