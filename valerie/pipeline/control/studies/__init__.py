"""Studies in the control loop, and the users' commands on them."""
