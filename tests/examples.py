"""What tests of several packages take for granted of a scene."""

from pipeline.world.layout import LayoutRules

RULES = LayoutRules((2, 3), (0.05, 0.35, 0.40, 0.20), 0.12, 0.88, 0.12, 0.015, 0.97, 1.03)  # as in conf/scenes.yaml
