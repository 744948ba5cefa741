"""Verdicts on requirements, and the gate of a CI pipeline."""
