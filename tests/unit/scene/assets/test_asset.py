"""References to assets: names, arguments, digests, packs of other distributions, and libraries that a manifest must not load."""

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.plugin_package import install_boxes, write_package
from valerie import plugins
from valerie.errors import InvalidInput, MissingDependency, UnknownName
from valerie.scene.assets.asset import asset_manifest, asset_names, is_generated, load_asset
from valerie.testing.asset_packs import AssetContract
from valerie.testing.assets import simple_manifest


@pytest.fixture
def installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Install the distribution ``box-assets``, and let the operator allow it."""
    yield install_boxes(tmp_path / "boxes", monkeypatch)
    sys.modules.pop("boxes", None)
    monkeypatch.undo()


@pytest.mark.usefixtures("installed")
class TestBoxes(AssetContract):
    name = "boxes"
    other = {"bearing_deg": 90.0}  # noqa: RUF012


@pytest.mark.usefixtures("installed")
class TestAPackOfAnotherDistribution:
    def test_makes_assets_like_those_of_this_one(self) -> None:
        assert asset_names()[-1] == "boxes"
        assert is_generated("boxes")
        asset = load_asset({"name": "boxes", "bearing_deg": 45})
        assert asset.manifest.bearing_deg == 45.0
        assert set(asset.base.nodes) > set(simple_manifest().persons)

    def test_is_refused_where_the_operator_does_not_name_it(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setenv("VALERIE_PLUGINS", "another-package")
        sys.modules.pop("boxes", None)
        assert "boxes" not in asset_names()
        offered = "asset boxes: offered by the package box-assets, which VALERIE_PLUGINS does not name"
        for reference in ("boxes", {"name": "boxes", "seed": 1}):
            with pytest.raises(InvalidInput, match=offered):
                asset_manifest(reference)
        assert "boxes" not in sys.modules
        assert any("box-assets offers asset boxes" in notice for notice in plugins.look_at_installed())

    def test_cannot_take_over_the_name_of_an_asset_of_this_distribution(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        points = {"valerie.assets": {"urban-street": "boxes"}}
        monkeypatch.syspath_prepend(str(write_package(tmp_path / "other", "taker", modules={}, entry_points=points)))
        monkeypatch.setenv("VALERIE_PLUGINS", "box-assets, taker")
        assert asset_manifest("urban-street")[0].title == "Urban street"

    def test_says_what_it_needs_and_is_not_there(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        points = {"valerie.assets": {"lost": "no_such_module"}}
        monkeypatch.syspath_prepend(str(write_package(tmp_path / "other", "lost", modules={}, entry_points=points)))
        monkeypatch.setenv("VALERIE_PLUGINS", "lost")
        with pytest.raises(MissingDependency, match="asset 'lost' is not installed"):
            asset_manifest("lost")

    @pytest.mark.parametrize("seed", [-1, "seven", 1.5])
    def test_an_argument_of_the_wrong_kind_names_its_field(self, seed: object) -> None:
        with pytest.raises(InvalidInput, match=r"asset\.seed"):
            asset_manifest({"name": "boxes", "seed": seed})

    def test_a_misspelt_argument_has_near_matches(self) -> None:
        with pytest.raises(UnknownName, match="did you mean seed"):
            asset_manifest({"name": "boxes", "sed": 7})


def test_an_unknown_asset_lists_near_matches() -> None:
    with pytest.raises(UnknownName, match="urban-street"):
        asset_manifest("urban-streets")


def test_an_asset_mapping_without_name_is_refused() -> None:
    with pytest.raises(InvalidInput, match="name"):
        asset_manifest({"seed": 7})


@pytest.mark.processes
def test_the_manifest_loads_neither_mesh_nor_graphics_libraries(installed: Path) -> None:
    code = (
        "import sys; from valerie.scene.assets.asset import asset_manifest;"
        "asset_manifest('urban-street'); asset_manifest('boxes');"
        "print(sorted(m for m in ('trimesh', 'pygltflib', 'cv2', 'moderngl', 'pyrender', 'torch') if m in sys.modules))"
    )
    path = os.pathsep.join(filter(None, (os.environ.get("PYTHONPATH"), str(installed))))
    environment = {**os.environ, "PYTHONPATH": path}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=False)
    assert done.stdout.strip() == "[]", done.stderr
