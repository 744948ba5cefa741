"""Engines that run networks: torch (the reference), OpenVINO and onnxruntime, one file each."""
