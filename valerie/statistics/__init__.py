"""What numbers of a run can be said to be true of, and how certainly; pure functions of arrays (docs/statistics.md)."""
