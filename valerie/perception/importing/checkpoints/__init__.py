"""Checkpoints of other programs: read without running code, recognised by the names of their tensors, converted to ours."""
