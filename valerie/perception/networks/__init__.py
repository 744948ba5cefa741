"""The segmentation networks that ship with VALERIE, in plain torch."""
