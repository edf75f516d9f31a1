"""The schema of conf/: a pydantic model per group of parameters, and the files and parameters of each stage."""
