"""Means, shares and spreads by pedestrian and function, and their words."""
