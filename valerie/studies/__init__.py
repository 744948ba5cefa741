"""From the document of a study to its strategy, its runs and its scores: pure functions, no database, no queue."""
