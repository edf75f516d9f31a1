"""Study: attempts to refute the effects of added items, and a world in which association misleads."""
