"""What is installed: every package and its data, and versions that are known to work together."""

import tomllib
from pathlib import Path

from packaging.requirements import Requirement

ROOT = Path(__file__).parents[1]
PYPROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))


def test_constraints_pin_every_direct_dependency_as_declared() -> None:
    project = PYPROJECT["project"]
    declared = [
        *project["dependencies"],
        *(line for more in project["optional-dependencies"].values() for line in more),
    ]
    lines = (ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines()
    pinned = dict(line.split("==") for line in lines if not line.startswith("#"))
    for requirement in map(Requirement, declared):
        assert pinned[requirement.name.lower()] in requirement.specifier
    assert set(pinned) == {Requirement(line).name.lower() for line in declared}


def test_every_package_is_installed() -> None:
    tool = PYPROJECT["tool"]["setuptools"]
    inside = {".".join(path.parent.relative_to(ROOT).parts) for path in (ROOT / "wildpuppet").rglob("__init__.py")}
    assert set(tool["packages"]) == inside | {"wildpuppet.pipelines", "wildpuppet.configs"}
    data = {path.suffix for path in (ROOT / "configs").iterdir() if path.is_file()} - {".py"}
    assert data == {Path(pattern).suffix for pattern in tool["package-data"]["wildpuppet.configs"]}
