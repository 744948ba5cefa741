"""Engines that run networks: torch (the reference), OpenVINO and onnxruntime, each in a file of its own."""
