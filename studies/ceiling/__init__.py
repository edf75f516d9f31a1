"""Study: what the paper's model would need to judge new scenes."""
