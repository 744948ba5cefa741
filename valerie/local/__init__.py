"""A deployment on this machine, as the command line and Python use it."""
