"""Products, CPU time and space of a run before it starts."""
