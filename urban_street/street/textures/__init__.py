"""Procedural textures of the street: every pixel is made from seeded noise."""
