"""The house has three floors, and imports only go down (app → planner → scenes)."""

import ast
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
ALLOWED_BELOW = {"scenes": {"scenes"}, "planner": {"planner", "scenes"}, "app": {"app", "planner", "scenes"}}
FLOORS = set(ALLOWED_BELOW)
KEPT_UPSTAIRS = {"fastapi", "starlette", "uvicorn", "viser", "websockets"}


def imported(path: Path) -> set[str]:
    """Top-level names that a module imports, wherever in it."""
    names = set()
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.Call) and getattr(node.func, "attr", "") == "import_module":
            names.add(ast.literal_eval(node.args[0]).split(".")[0])
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative imports hide the floor that they lead to"
            names.add((node.module or "").split(".")[0])
    return names


def modules(floor: str) -> list[Path]:
    return sorted((ROOT / floor).rglob("*.py"))


@pytest.mark.parametrize("floor", sorted(FLOORS))
def test_imports_only_go_down(floor: str) -> None:
    for path in modules(floor):
        climbing = imported(path) & FLOORS - ALLOWED_BELOW[floor]
        assert not climbing, f"{path.relative_to(ROOT)} imports {climbing}"


@pytest.mark.parametrize("floor", ["scenes", "planner"])
def test_only_the_app_knows_the_web(floor: str) -> None:
    for path in modules(floor):
        assert not imported(path) & KEPT_UPSTAIRS, path.relative_to(ROOT)


def test_only_the_physics_module_knows_pybullet() -> None:
    knowing = {
        str(path.relative_to(ROOT))
        for floor in FLOORS
        for path in modules(floor)
        if "pybullet" in imported(path)
    }
    assert knowing == {"scenes/physics.py"}


def test_every_dependency_is_used_and_every_import_declared() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    module_of = {
        "pillow": "PIL",
        "python-multipart": "python_multipart",
        "stable-baselines3": "stable_baselines3",
        "xarray-spatial": "xrspatial",
    }
    # fastapi's form parser and torch's event writer import them
    through_others = {"python_multipart", "tensorboard"}
    declared, for_the_bench, for_a_cluster = (
        {
            module_of.get(name, name)
            for requirement in requirements
            for name in [requirement.split("[")[0].split("=")[0].split(">")[0].strip()]
        }
        for requirements in (
            project["dependencies"],
            project["optional-dependencies"]["bench"],
            project["optional-dependencies"]["cluster"],
        )
    )
    used = set().union(*(imported(path) for floor in FLOORS for path in modules(floor)))
    assert declared - through_others <= used, "declared and not used"
    # pybullet brings pybullet_data; starlette is fastapi's own base, pydantic_core pydantic's
    brought = {"pybullet_data", "starlette", "pydantic_core", "static"}
    foreign = used - FLOORS - set(sys.stdlib_module_names) - brought
    assert foreign - declared <= for_the_bench | for_a_cluster, "used and not declared"
    optional = {path for floor in FLOORS for path in modules(floor) if imported(path) & for_the_bench}
    assert {path.relative_to(ROOT).parts[:2] for path in optional} == {("app", "bench")}


def test_the_top_level_holds_nothing_else() -> None:
    folders = {"app", "planner", "scenes", "static", "tests"}
    allowed = folders | {"pyproject.toml", "Dockerfile", "README.md", "LICENSE"}
    listing = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=False)
    top = {line.split("/")[0] for line in listing.stdout.splitlines()}
    assert {name for name in top if not name.startswith(".")} <= allowed
