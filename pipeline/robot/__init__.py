"""Carry out paths with a robot's arm: postures, timing, physics, export.

The modules need the packages of the extra `robot`.
"""
