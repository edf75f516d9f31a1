"""Processes, memory, random streams, errors and atomic files."""
