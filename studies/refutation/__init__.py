"""Study: refutation."""
