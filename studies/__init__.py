"""Studies beyond the paper, one folder per question; deleting a folder removes its study."""
