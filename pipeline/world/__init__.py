"""The simulated table world: items, layouts, rendering, Bezier paths, hand motion and the users' rules.

`rules` alone decides which paths are valid.
"""
