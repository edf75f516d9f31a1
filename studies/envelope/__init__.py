"""Study: envelope."""
