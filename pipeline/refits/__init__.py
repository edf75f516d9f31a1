"""Scenes and demonstrations that stages make for themselves, and models fitted to them only for their answers."""
