"""What conf/ may hold: a pydantic model for each group of parameters, and which files of the graph a stage reads."""
