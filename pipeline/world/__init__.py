"""The simulated world: items, layouts, rendering, Bezier paths, hands; `rules` alone decides what is valid."""
