"""`python -m vita.sim.robot_files [FOLDER]` writes the URDF and the meshes of every arm that ships."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from vita.assets import asset
from vita.sim.arm_spec import ArmSpec, Cylinder
from vita.sim.hidden_faces import without_hidden
from vita.sim.shading import shaded
from vita.sim.shapes import Solid, joined

HALF = np.pi / 2


def write(folder: Path, specs: Iterable[ArmSpec]) -> list[Path]:
    """Write the URDFs and meshes of `specs` below `folder` and return what was written."""
    files: dict[Path, str] = {}
    bodies: dict[tuple[Path, str], ArmSpec] = {}  # Arms in one folder share bodies; drawn once is enough.
    for spec in specs:
        home = folder / spec.folder
        files[home / f"{spec.name}.urdf"] = urdf_text(spec)
        bodies |= {(home / "meshes", body): spec for body in spec.meshes}
    for (meshes, body), spec in bodies.items():
        for color, solid in seen_solids(spec, body).items():
            files[meshes / f"{body}_{color}.obj"] = _obj(solid)
    for path, text in files.items():
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="ascii", newline="\n")
    return list(files)


def seen_solids(spec: ArmSpec, body: str) -> dict[str, Solid]:
    """Colour to what is seen of a drawing: what goes into one mesh file."""
    parts = spec.drawings[body]()
    seen: dict[str, list[Solid]] = {}
    for (color, _), solid in zip(parts, without_hidden([solid for _, solid in parts]), strict=True):
        seen.setdefault(color, []).append(solid)
    return {color: joined(solids) for color, solids in seen.items()}


def urdf_text(spec: ArmSpec) -> str:
    """The URDF of an arm, its joint limits and frames exact to the last bit."""
    lines = ['<?xml version="1.0"?>', f'<robot name="{spec.name}">']
    for color, rgb in spec.colors.items():
        lines.append(f'  <material name="{color}"><color rgba="{_text(*rgb)} 1"/></material>')
    names = ("base", *(f"link{i + 1}" for i in range(spec.chain.n)))
    for i, name in enumerate(names):
        lines += _link(name, spec, i)
    for i in range(spec.chain.n):
        lines += _joint(names, spec, i)
    return "\n".join([*lines, "</robot>"]) + "\n"


def _joint(names: tuple[str, ...], spec: ArmSpec, i: int) -> list[str]:
    # Joint i + 1 sits at frame i: what stands between them is the fixed part of joint i.
    chain = spec.chain
    a, d, alpha = (chain.a[i - 1], chain.d[i - 1], chain.alpha[i - 1]) if i else (0, 0, 0)
    # Its zero is turned by the offset. The twists of our arms are quarter turns, behind which a turn about
    # the tilted z is one about y: Rx(alpha) Rz(offset) = Rz(yaw) Ry(pitch) Rx(alpha).
    offset = chain.offset[i]
    pitch, yaw = -round(np.sin(alpha)) * offset, round(np.cos(alpha)) * offset
    return [
        f'  <joint name="joint{i + 1}" type="revolute">',
        f'    <parent link="{names[i]}"/><child link="{names[i + 1]}"/>',
        f'    <origin xyz="{_text(a, 0, d)}" rpy="{_text(alpha, pitch, yaw)}"/><axis xyz="0 0 1"/>',
        f'    <limit lower="{_text(spec.limits[i][0])}" upper="{_text(spec.limits[i][1])}" '
        f'velocity="{_text(spec.speeds[i])}" effort="{_text(spec.torques[i])}"/>',
        "  </joint>",
    ]


def _link(name: str, spec: ArmSpec, i: int) -> list[str]:
    mass, hull, mesh = spec.masses[i], spec.hulls[i], spec.meshes[i]
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
    for color in dict.fromkeys(color for color, _ in spec.drawings[mesh]()):
        lines += [
            f'    <visual><geometry><mesh filename="meshes/{mesh}_{color}.obj"/></geometry>'
            f'<material name="{color}"/></visual>',
        ]
    return [*lines, *_collision(hull, tilt), "  </link>"]


def _collision(hull: Cylinder, tilt: tuple[float, float, float]) -> list[str]:
    return [
        f'    <collision><origin xyz="{_text(*hull.xyz)}" rpy="{_text(*tilt)}"/>',
        f'      <geometry><cylinder radius="{_text(hull.radius)}" length="{_text(hull.length)}"/></geometry>',
        "    </collision>",
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
    return " ".join(repr(float(v) + 0.0).removesuffix(".0") for v in values)


if __name__ == "__main__":
    from vita.sim.shipped import SHIPPED

    target = Path(sys.argv[1]) if len(sys.argv) > 1 else asset("robots")
    written = write(target, SHIPPED.values())
    print(f"{len(written)} files, {sum(path.stat().st_size for path in written) / 1e6:.2f} MB in {target}")
