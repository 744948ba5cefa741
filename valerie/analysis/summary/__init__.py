"""Means, shares and spreads by pedestrian and function, as numbers and text."""
