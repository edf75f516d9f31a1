"""Fitting the reward map by maximum entropy or by ranking."""
