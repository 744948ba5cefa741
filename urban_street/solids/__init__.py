"""Solids for streets, vehicles and riders: surfaces, and primitives for building them."""
