"""A source's statements and printed numbers, compared with a run."""
