"""Carry out paths with a robot's arm: postures, timing, clearances in three dimensions, physics, export.

The modules need the packages of the extra `robot`.
"""
