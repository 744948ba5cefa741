"""Confirmed findings, candidates, and specs of runs that examine them further."""
