"""Runs from Python: notebooks, scripts and pipelines."""
