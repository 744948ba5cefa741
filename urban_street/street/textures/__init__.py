"""Procedural textures of the street, made from seeded noise."""
