"""Checkpoints of other programs: read without running them, recognised by their tensors' names, converted to ours."""
