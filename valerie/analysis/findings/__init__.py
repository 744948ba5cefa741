"""Effects that places confirm, candidates, and the specs that examine them further."""
