"""Study: whether a robot's arm can carry out the repaired paths."""
