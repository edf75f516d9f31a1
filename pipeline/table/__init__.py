"""The world: items, scene layout, rendering, Bezier paths, and the users' rules (the truth)."""
