"""Study: acceptance."""
