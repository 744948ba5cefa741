"""The validation flow (figure 3 of the paper) in rounds: verify, find failures, train on them, verify the new version."""
