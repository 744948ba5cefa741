"""The rules of .importlinter, and the modules that processes really load."""

import ast
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]

#: Slow to load, large, or needing a system library: nothing for a server or a command line.
HEAVY = (
    "torch", "onnx", "onnxruntime", "openvino", "transformers", "moderngl", "OpenGL", "pyrender", "cv2", "trimesh",
    "scipy.stats",
)  # fmt: skip


def _python(program: str) -> str:
    done = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def _loaded_by(imports: str, names: tuple[str, ...]) -> list[str]:
    program = f"import sys\n{imports}\nprint(*[name for name in {names!r} if name in sys.modules])"
    return _python(program).split()


def test_imports_follow_the_rules() -> None:
    done = subprocess.run(
        [str(Path(sys.executable).with_name("lint-imports")), "--no-cache"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout


@pytest.mark.parametrize(
    "module",
    [
        "services.api.app",
        "valerie.cli",
        "valerie.pipeline.control.submit",
        "valerie.pipeline.control.loop",
        "valerie.pipeline.control.planning",
        "valerie.embedded.supervisor",
    ],
)
def test_no_heavy_library_is_loaded(module: str) -> None:
    assert _loaded_by(f"import {module}", HEAVY) == []


@pytest.mark.parametrize(
    ("module", "unneeded"),
    [
        ("valerie.cli.main", ("numpy", "pyarrow", "sqlalchemy", "httpx")),
        ("valerie.cli.following", ("numpy", "pyarrow", "sqlalchemy")),
        ("valerie.pipeline.functions.probe", ("pyarrow", "sqlalchemy", "celery", "lark")),
    ],
)
def test_what_starts_often_loads_only_what_it_needs(module: str, unneeded: tuple[str, ...]) -> None:
    assert _loaded_by(f"import {module}", unneeded) == []


def test_the_api_lists_engines_functions_and_assets_without_heavy_libraries(tmp_path: Path) -> None:
    program = (
        "import sys\n"
        "from pathlib import Path\n"
        "from valerie import plugins\n"
        "from valerie.settings import load_settings\n"
        "from valerie.pipeline.functions import catalog\n"
        f"settings = load_settings(data_dir=Path({str(tmp_path)!r}))\n"
        "assert plugins.renderer_names()\n"
        "assert catalog.assets(settings)\n"
        "assert catalog.asset(settings, 'urban-street')['parameters']\n"
    )
    assert _loaded_by(program, HEAVY) == []


def test_a_worker_starts_without_the_libraries_of_other_stages() -> None:
    assert _loaded_by("import services.infer_worker.app", ("moderngl", "OpenGL", "pyrender", "scipy")) == []
    assert _loaded_by("import services.render_worker.app", ("torch", "scipy")) == []
    assert _loaded_by("import services.eval_worker.app", ("torch", "moderngl", "scipy", "jinja2")) == []


def test_a_command_that_reads_a_deployment_loads_neither_queues_nor_migrations() -> None:
    imports = "import valerie.local.deployment, valerie.pipeline.base.context, valerie.db.migrate"
    assert _loaded_by(imports, ("celery", "kombu", "redis", "alembic", "opentelemetry")) == []


def test_the_command_line_answers_without_loading_what_it_does_not_need() -> None:
    unneeded = ("numpy", "pydantic", "sqlalchemy", "celery", "fastapi", "httpx", "redis")
    assert _loaded_by("import valerie.cli.main", unneeded) == []


def test_a_command_that_asks_a_server_loads_no_part_of_one() -> None:
    parts = ("numpy", "sqlalchemy", "celery", "fastapi", "redis", "torch", "openvino")
    assert _loaded_by("import valerie.cli.main, valerie.cli.connecting", parts) == []


def test_the_programs_inside_blender_and_valerie_import_nothing_of_each_other() -> None:
    # Programs under two licences that exchange messages or files: docs/cycles.md.
    package = ROOT / "valerie" / "rendering" / "cycles" / "inside"
    inside = set(package.glob("*.py"))
    assert {module.name for module in inside} >= {"__main__.py", "convert.py"}
    imported = set().union(*map(_imports, inside))
    assert imported - sys.stdlib_module_names == {"numpy", "bpy", "mathutils", "."}
    ours = {*(ROOT / "valerie").rglob("*.py"), *(ROOT / "services").rglob("*.py")} - inside
    assert not [file for file in ours if re.search(r"import.*\binside\b", file.read_text("utf-8"))]


def _imports(file: Path) -> set[str]:
    """First parts of all that a module imports, wherever in it; a dot for what stands beside it."""
    nodes = list(ast.walk(ast.parse(file.read_text("utf-8"))))
    plain = {alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names}
    imports = plain | {"." * node.level or node.module or "" for node in nodes if isinstance(node, ast.ImportFrom)}
    return {name.partition(".")[0] or name for name in imports}
