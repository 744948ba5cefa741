"""A source's statements and printed numbers beside what a run shows."""
