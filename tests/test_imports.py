"""Import rules of the design: the servo cannot see cameras, kinematics or ground truth."""

from __future__ import annotations

import ast
import importlib
import pkgutil
import subprocess
import sys
from pathlib import Path

import pytest

import vita

PACKAGE = Path(vita.__file__).parent
FILES = sorted(PACKAGE.rglob("*.py"))


def imported(path: Path) -> set[str]:
    """Every module that a file imports, also inside functions."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            names.add(node.module or "")
            names |= {f"{node.module}.{alias.name}" for alias in node.names if node.module == "vita"}
    return names


def uses(path: Path, package: str) -> bool:
    return any(name == package or name.startswith(package + ".") for name in imported(path))


def room(path: Path) -> str:
    parts = path.relative_to(PACKAGE).parts
    return parts[0] if len(parts) > 1 else ""


PURE = [f for f in FILES if room(f) in ("constraints", "servo", "stereo", "impedance")]
ALLOWED_IN_PURE = {"numpy", "scipy", "vita.types", "vita.errors", "vita.constraints", "vita.servo"}
ALLOWED_IN_STEREO = {"numpy", "scipy", "vita.types", "vita.errors", "vita.poses", "vita.stereo"}
ALLOWED_IN_IMPEDANCE = ALLOWED_IN_STEREO | {"vita.impedance", "vita.servo"}
"""The second mode knows cameras and arm by their drawings; nothing of the simulation."""
ALLOWED = {"stereo": ALLOWED_IN_STEREO, "impedance": ALLOWED_IN_IMPEDANCE}


@pytest.mark.parametrize("path", PURE, ids=lambda p: str(p.relative_to(PACKAGE)))
def test_the_rooms_of_control_import_only_numbers_and_plain_types(path: Path) -> None:
    for name in imported(path):
        top = name.split(".")[0]
        fine = top in sys.stdlib_module_names or any(
            name == allowed or name.startswith(allowed + ".")
            for allowed in ALLOWED.get(room(path), ALLOWED_IN_PURE)
        )
        assert fine, f"{path.name} imports {name}"


@pytest.mark.parametrize(
    ("package", "home"),
    [("viser", {"ui"}), ("pybullet", {"sim"}), ("cv2", {"vision", "sim", "ui", "tracking", "calibration"})],
)
def test_only_its_own_room_imports(package: str, home: set[str]) -> None:
    offenders = [str(f.relative_to(PACKAGE)) for f in FILES if room(f) not in home and uses(f, package)]
    assert not offenders, f"{package} is imported outside {home}: {offenders}"


def test_the_rule_would_notice_a_breach(tmp_path: Path) -> None:
    bad = tmp_path / "bad.py"
    bad.write_text("def f():\n    import pybullet as p\n    from vita.sim import world\n")
    assert uses(bad, "pybullet") and uses(bad, "vita.sim")


def test_importing_vita_brings_in_neither_viser_nor_pybullet_nor_opencv() -> None:
    code = (
        "import sys, vita, vita.servo, vita.constraints; "
        "print([m for m in ('viser', 'pybullet', 'cv2') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def modules() -> list[str]:
    return [m.name for m in pkgutil.walk_packages([str(PACKAGE)], "vita.") if not m.name.endswith("__main__")]


@pytest.mark.parametrize("name", modules())
def test_every_public_name_can_be_imported(name: str) -> None:
    module = importlib.import_module(name)
    for public in getattr(module, "__all__", []):
        assert hasattr(module, public), f"{name}.__all__ names {public}, which does not exist"
