"""The Barrett WAM, built from its published figures: `python -m vita.sim.wam` writes URDFs and meshes.

The base frame of both arms is the shoulder (frame 0 of the Denavit-Hartenberg chain). Link i of
the URDF turns with joint i and has its origin on that joint's axis, where frame i - 1 is.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from vita.assets import asset
from vita.sim.dh import DHChain
from vita.sim.shading import shaded
from vita.sim.shapes import Solid
from vita.sim.wam_shapes import COLORS, body_solids, link_solids

HALF = np.pi / 2
SHOULDER_HEIGHT = 0.346
"""Shoulder above the mounting plane, from the manufacturer's drawings [m]."""
SPEED = 2.0
"""Joint speed limit; published figures disagree, this is the flat one [rad/s]."""
BASE_MASS = 9.97
"""Mass of what does not move [kg]."""

LIMITS = ((-2.6, 2.6), (-2.0, 2.0), (-2.8, 2.8), (-0.9, 3.1), (-4.76, 1.24), (-1.6, 1.6), (-3.0, 3.0))
"""Joint limits [rad]."""
TORQUES = (77.3, 160.6, 95.6, 29.4, 11.6, 11.6, 2.7)
"""Joint torque limits [Nm]."""


@dataclass(frozen=True)
class Cylinder:
    """A collision cylinder in a link's frame; its mass is spread over it evenly."""

    radius: float
    length: float
    xyz: tuple[float, float, float]
    axis: str = "z"


@dataclass(frozen=True)
class WAM:
    """One configuration of the arm."""

    chain: DHChain
    masses: tuple[float, ...]
    """Link masses [kg]."""
    links: tuple[str, ...]
    """Mesh name of each moving link."""
    hulls: tuple[Cylinder, ...]
    """Collision shape of each moving link."""
    tool_reach: float
    """Tool frame beyond the last frame of the chain, along its z [m]."""


UPPER_HULLS = (
    Cylinder(0.14, 0.16, (0, 0, -0.06)),
    Cylinder(0.10, 0.16, (0, -0.07, 0), "y"),
    Cylinder(0.055, 0.40, (0, 0, 0.34)),
)
WAMS: Mapping[str, WAM] = {
    "wam4": WAM(
        chain=DHChain((0, 0, 0.045, -0.045), (0, 0, 0.55, 0), (-HALF, HALF, -HALF, HALF), (0,) * 4),
        masses=(10.77, 3.87, 1.80, 1.07),
        links=("link1", "link2", "link3", "outer"),
        hulls=(*UPPER_HULLS, Cylinder(0.04, 0.33, (-0.045, -0.18, 0), "y")),
        tool_reach=0.35,
    ),
    "wam7": WAM(
        chain=DHChain(
            (0, 0, 0.045, -0.045, 0, 0, 0),
            (0, 0, 0.55, 0, 0.30, 0, 0.0609),
            (-HALF, HALF, -HALF, HALF, -HALF, HALF, 0),
            (0,) * 7,
        ),
        masses=(10.77, 3.87, 1.80, 2.17, 0.357, 0.409, 0.075),
        links=("link1", "link2", "link3", "forearm", "wrist1", "wrist2", "flange"),
        hulls=(
            *UPPER_HULLS,
            Cylinder(0.045, 0.22, (-0.045, -0.11, 0), "y"),
            Cylinder(0.045, 0.08, (0, 0, 0.27)),
            Cylinder(0.035, 0.06, (0, 0, 0)),
            Cylinder(0.042, 0.02, (0, 0, 0.0509)),
        ),
        tool_reach=0.0,
    ),
}
READY = {
    "wam4": (0.0, 0.75, 0.0, 2.0),
    "wam7": (0.0, 0.72, 0.0, 2.1, 0.0, 0.1, 0.0),
}
"""Start poses: elbow bent, hand pointing down in front of the arm [rad]."""


def urdf_text(name: str) -> str:
    """The URDF of `wam4` or `wam7`."""
    wam = WAMS[name]
    lines = ['<?xml version="1.0"?>', f'<robot name="{name}">']
    for color, rgb in COLORS.items():
        lines.append(f'  <material name="{color}"><color rgba="{_text(*rgb)} 1"/></material>')
    lines += _link("base", "base", BASE_MASS, Cylinder(0.13, 0.2, (0, 0, -0.246)))
    for i, mesh in enumerate(wam.links):
        lines += _link(f"link{i + 1}", mesh, wam.masses[i], wam.hulls[i])
    for i in range(wam.chain.n):
        # Joint i + 1 sits at frame i: what stands between them is the fixed part of joint i.
        a, d, alpha = (wam.chain.a[i - 1], wam.chain.d[i - 1], wam.chain.alpha[i - 1]) if i else (0, 0, 0)
        parent = f"link{i}" if i else "base"
        lines += [
            f'  <joint name="joint{i + 1}" type="revolute">',
            f'    <parent link="{parent}"/><child link="link{i + 1}"/>',
            f'    <origin xyz="{_text(a, 0, d)}" rpy="{_text(alpha, 0, 0)}"/><axis xyz="0 0 1"/>',
            f'    <limit lower="{_text(LIMITS[i][0])}" upper="{_text(LIMITS[i][1])}" '
            f'velocity="{_text(SPEED)}" effort="{_text(TORQUES[i])}"/>',
            "  </joint>",
        ]
    return "\n".join([*lines, "</robot>"]) + "\n"


def mesh_texts() -> dict[str, str]:
    """File name to OBJ text of every mesh of both arms, one per body and colour."""
    bodies = ["base", *dict.fromkeys(mesh for wam in WAMS.values() for mesh in wam.links)]
    return {
        f"{body}_{color}.obj": _obj(solid) for body in bodies for color, solid in link_solids(body).items()
    }


def write(folder: Path) -> list[Path]:
    """Write the URDFs and meshes of both arms below `folder` and return what was written."""
    (folder / "meshes").mkdir(parents=True, exist_ok=True)
    files = {folder / f"{name}.urdf": urdf_text(name) for name in WAMS}
    files |= {folder / "meshes" / name: text for name, text in mesh_texts().items()}
    for path, text in files.items():
        path.write_text(text, encoding="ascii", newline="\n")
    return list(files)


def _link(name: str, mesh: str, mass: float, hull: Cylinder) -> list[str]:
    across = mass * (3 * hull.radius**2 + hull.length**2) / 12
    along = mass * hull.radius**2 / 2
    ixx, iyy, izz = (along if axis == hull.axis else across for axis in "xyz")
    tilt = {"x": (0, HALF, 0), "y": (HALF, 0, 0), "z": (0, 0, 0)}[hull.axis]
    lines = [
        f'  <link name="{name}">',
        f'    <inertial><origin xyz="{_text(*hull.xyz)}"/><mass value="{_text(mass)}"/>',
        f'      <inertia ixx="{ixx:.6g}" iyy="{iyy:.6g}" izz="{izz:.6g}" ixy="0" ixz="0" iyz="0"/>',
        "    </inertial>",
    ]
    for color in body_solids(mesh):
        lines += [
            f'    <visual><geometry><mesh filename="meshes/{mesh}_{color}.obj"/></geometry>'
            f'<material name="{color}"/></visual>',
        ]
    shape = f'<cylinder radius="{_text(hull.radius)}" length="{_text(hull.length)}"/>'
    return [
        *lines,
        f'    <collision><origin xyz="{_text(*hull.xyz)}" rpy="{_text(*tilt)}"/>',
        f"      <geometry>{shape}</geometry>",
        "    </collision>",
        "  </link>",
    ]


def _obj(solid: Solid) -> str:
    """A mesh as Wavefront text: 10 micrometres and a thousandth of a unit normal are plenty."""
    vertices, faces, normals = shaded(solid.vertices, solid.faces)
    lines = [f"v {_short(v, 5)}" for v in vertices]
    lines += [f"vn {_short(v, 3)}" for v in normals]
    lines += [" ".join(["f", *(f"{i}//{i}" for i in face)]) for face in (faces + 1).tolist()]
    return "\n".join(lines) + "\n"


def _short(values: np.ndarray, digits: int) -> str:
    # Adding zero turns -0.0 into 0.0.
    return " ".join(f"{x:g}" for x in (np.round(values, digits) + 0.0).tolist())


def _text(*values: float) -> str:
    """Numbers that read back as exactly the same numbers."""
    return " ".join(repr(float(v)).removesuffix(".0") for v in values)


if __name__ == "__main__":
    target = Path(sys.argv[1]) if len(sys.argv) > 1 else asset("robots") / "wam"
    written = write(target)
    print(f"{len(written)} files, {sum(path.stat().st_size for path in written) / 1e6:.2f} MB in {target}")
