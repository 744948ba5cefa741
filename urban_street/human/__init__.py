"""Pedestrians: real human bodies from MakeHuman's data, posed and clothed (see `figure` and `catalogue`)."""

from urban_street.human.catalogue import CHARACTERS
from urban_street.human.figure import Figure, figure

__all__ = ["CHARACTERS", "Figure", "figure"]
