"""Lookup tables from a function's own classes to Cityscapes train ids, checked before anything runs.

A class of the function takes its target from the class map (by name or by id); otherwise it is the Cityscapes class of the
same name. A class without either is *predicted void*: on a labelled pixel it counts as missed, and it is never a person by
chance. So a function that distinguishes only "person or not" maps one class and leaves out the other.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from valerie.errors import InvalidInput, UnknownName
from valerie.labels import BY_NAME, CITYSCAPES, PERSON, TRAIN_LABELS, VOID, VOID_NAME

#: Ids of a function's classes are 0…254; 255 in its label map is void, as in Cityscapes.
MAX_CLASSES: Final = 255

#: Words in the class names of other data sets that mean persons, and words that mean riders, which are not persons.
_PERSON_WORDS: Final = ("person", "pedestrian", "people", "human", "walker")
_RIDER_WORDS: Final = ("rider", "cyclist")

#: Named lists of classes, which documents can refer to.
CLASS_LISTS: Final[Mapping[str, tuple[str, ...]]] = {
    "cityscapes": tuple(label.name for label in TRAIN_LABELS),
    "cityscapes-label-ids": tuple(label.name for label in CITYSCAPES),
}


def class_lookup(classes: Sequence[str], class_map: Mapping[str, str], *, field: str = "output") -> NDArray[np.uint8]:
    """Return the table from ids of a function's classes to train ids.

    Args:
        classes: the function's classes, in the order of its channels or ids.
        class_map: name or id of a class to a Cityscapes class or ``void``.
        field: part of the document that contains both, for errors.

    Returns:
        (256,) uint8: train ids 0…18, or 255 (void); also for ids that no class has.

    Raises:
        UnknownName: a key is not a class, or a value is not a Cityscapes class; near matches are named.
        InvalidInput: a class is repeated or mapped both by name and by id, or no class leads to an evaluated class.
    """
    twice = sorted({name for name in classes if classes.count(name) > 1})
    if twice:
        raise InvalidInput("classes must differ", field=f"{field}.classes", value=", ".join(twice))
    table = np.full(256, VOID, np.uint8)
    for number, name in enumerate(classes):
        if name in BY_NAME:
            table[number] = BY_NAME[name].train_id
    mapped: dict[int, str] = {}
    for key, target in class_map.items():
        place = f"{field}.class_map.{key}"
        if key in classes:
            number = classes.index(key)
        elif key.isdecimal() and int(key) < len(classes):
            number = int(key)
        else:
            raise UnknownName("class of the function", key, classes, field=place)
        if number in mapped:
            raise InvalidInput(f"the class is mapped already, as {mapped[number]!r}", field=place)
        if target != VOID_NAME and target not in BY_NAME:
            raise UnknownName("Cityscapes class", target, (*BY_NAME, VOID_NAME), field=place)
        mapped[number] = key
        table[number] = VOID if target == VOID_NAME else BY_NAME[target].train_id
    if (table == VOID).all():
        raise InvalidInput(
            "no class leads to a Cityscapes class that is evaluated",
            field=f"{field}.class_map",
            value=", ".join(classes[:8]),
            limit="for example: person: person",
        )
    table.setflags(write=False)
    return table


def require_person(classes: Sequence[str], class_map: Mapping[str, str]) -> None:
    """Refuse a function that can never predict a person: every run would score it 0 %.

    Args:
        classes, class_map: see `class_lookup`.

    Raises:
        InvalidInput: no class maps to ``person``; the limit proposes a class map.
    """
    if PERSON.train_id in class_lookup(classes, class_map, field="output")[: len(classes)]:
        return
    persons = [
        name
        for name in classes
        if any(word in name.lower() for word in _PERSON_WORDS)
        and not any(word in name.lower() for word in _RIDER_WORDS)
    ]
    entries = ", ".join(f"{name}: person" for name in persons)
    raise InvalidInput(
        "no class of the function is a person, and persons are what runs measure",
        field="output.class_map",
        value=", ".join(classes[:8]),
        limit=f"class_map: {{{entries}}}" if persons else "class_map: {NAME: person}, NAME being the class of persons",
    )
