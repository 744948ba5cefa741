"""Requirements judged, and the gate of a CI pipeline."""
