"""Solids for streets, vehicles and riders: surfaces, and the primitives that they are built from."""
