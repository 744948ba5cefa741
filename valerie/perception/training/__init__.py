"""Training of the built-in networks on rendered frames. Running a trained network does not need this package."""
