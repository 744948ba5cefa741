"""Pedestrians: real human bodies from MakeHuman's data, posed and clothed (see `figure` and `catalogue`)."""

from urban_street.human.characters import CHARACTERS, Character, build_character, seat_character
from urban_street.human.figure import Figure, figure

__all__ = ["CHARACTERS", "Character", "Figure", "build_character", "figure", "seat_character"]
