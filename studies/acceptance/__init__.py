"""Study: accept paths such that at most a given share of them is invalid."""
