"""Study: rule families."""
