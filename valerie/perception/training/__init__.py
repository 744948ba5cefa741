"""Training of the built-in networks on rendered frames. Running a trained network needs nothing from here."""
