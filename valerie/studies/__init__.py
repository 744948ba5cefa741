"""Turn the document of a study into its strategy, its runs and its scores; without database or queue."""
