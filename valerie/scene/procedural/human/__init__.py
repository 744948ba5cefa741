"""Pedestrians: real human bodies from MakeHuman's data, posed in a walk and clothed (see `characters`)."""

from valerie.scene.procedural.human.characters import CHARACTERS, REVISION, Character, build_character

__all__ = ["CHARACTERS", "REVISION", "Character", "build_character"]
