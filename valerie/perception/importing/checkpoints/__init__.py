"""Checkpoints of other programs: read without running anything in them, recognised by their keys, and renamed to ours."""
