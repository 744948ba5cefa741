"""The document of a study, and the score of a variant."""
