"""Advance studies in the control loop, and serve the commands of users."""
