"""Study: attempts to refute the effects of added items."""
