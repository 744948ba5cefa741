"""Studies: proposed, run and decided by the control loop, and asked by people."""
