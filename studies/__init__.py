"""Studies beyond the paper, one question each; delete a folder and its question is gone."""
