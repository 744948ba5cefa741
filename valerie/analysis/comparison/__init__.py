"""Two functions, two versions or two runs on the same frames."""
