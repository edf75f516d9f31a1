"""Study: confounding."""
