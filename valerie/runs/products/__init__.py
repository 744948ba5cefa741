"""Frames and products of a run, their inputs and states."""
