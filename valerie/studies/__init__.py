"""Studies: strategies, runs and scores from a study's document; without database or queue."""
