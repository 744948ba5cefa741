"""Intervals, contrasts and verdicts with their estimands: pure functions of arrays (docs/statistics.md)."""
