"""Study: robustness."""
