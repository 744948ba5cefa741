"""The street: made once, since meshes and textures are built when they are first looked at."""

import pytest

from urban_street.street.build import StreetContent, build_street
from urban_street.street.layout import layout_street
from urban_street.street.plan import StreetSettings
from valerie.scene.assets.asset import SceneAsset, load_asset


@pytest.fixture(scope="session")
def asset() -> SceneAsset:
    """Return the street with default arguments."""
    return load_asset("urban-street")


@pytest.fixture(scope="session")
def content() -> StreetContent:
    """Return all parts of the street with default arguments, without persons and traffic."""
    return build_street(layout_street(StreetSettings()))
