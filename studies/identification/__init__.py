"""Study: identification."""
