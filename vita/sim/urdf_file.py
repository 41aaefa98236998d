"""Reads URDF files. Whatever is wrong with one is said with its place and the reason."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from vita.errors import BadInput
from vita.sim.urdf import GREY, KINDS, Geometry, Urdf, UrdfJoint, UrdfLink, rotation_about
from vita.types import Array


def read_urdf(path: Path) -> Urdf:
    """Parse a URDF file. Raises `BadInput` with the place and the reason when it is not usable."""
    if not path.is_file():
        reason = "this is a folder, not a URDF file" if path.exists() else "no such file"
        raise BadInput(reason, str(path))
    try:
        robot = ET.parse(path).getroot()
    except (ET.ParseError, UnicodeDecodeError, OSError) as reason:
        raise BadInput(f"not a readable URDF: {reason}", str(path)) from reason
    if robot.tag != "robot":
        raise BadInput(f"not a URDF: the outermost element is <{robot.tag}>, not <robot>", str(path))
    palette = _palette(robot)
    links = {link.name: link for link in (_link(e, palette, path) for e in robot.findall("link"))}
    joints = [_joint(element, path) for element in robot.findall("joint")]
    if not links:
        raise BadInput("the robot has no links", str(path))
    root, ordered = _sorted_tree(links, joints, path)
    return Urdf(path, robot.get("name") or path.stem, root, links, ordered)


def _sorted_tree(
    links: Mapping[str, UrdfLink], joints: list[UrdfJoint], path: Path
) -> tuple[str, tuple[UrdfJoint, ...]]:
    """The root link and the joints with parents first; refuses what is not one tree."""
    for joint in joints:
        for link in (joint.parent, joint.child):
            if link not in links:
                raise BadInput(f"joint {joint.name!r} names link {link!r}, which does not exist", str(path))
    children = [joint.child for joint in joints]
    roots = [name for name in links if name not in children]
    if len(roots) != 1 or len(set(children)) != len(children):
        found = ", ".join(roots) or "none (the joints form a loop)"
        raise BadInput(f"the links must form one tree with one root; roots: {found}", str(path))
    reached, ordered, waiting = {roots[0]}, [], list(joints)
    while waiting:
        ready = [joint for joint in waiting if joint.parent in reached]
        if not ready:
            raise BadInput(f"joint {waiting[0].name!r} is not connected to {roots[0]!r}", str(path))
        ordered += ready
        reached |= {joint.child for joint in ready}
        waiting = [joint for joint in waiting if joint.child not in reached]
    return roots[0], tuple(ordered)


def _joint(element: ET.Element, path: Path) -> UrdfJoint:
    name = element.get("name") or "unnamed"
    where = f"{path}: joint {name!r}"
    kind = element.get("type") or ""
    if kind not in KINDS:
        raise BadInput(f"type {kind!r} is not supported; choices: {', '.join(KINDS)}", where)
    parent, child = element.find("parent"), element.find("child")
    if parent is None or child is None:
        raise BadInput("needs a <parent> and a <child>", where)
    axis = np.array([1.0, 0.0, 0.0])
    if (given := element.find("axis")) is not None:
        axis = np.array(_numbers(given, "xyz", 3, (1.0, 0.0, 0.0), where))
    if kind != "fixed" and np.linalg.norm(axis) < 1e-9:
        raise BadInput("the axis has no length", where)
    axis = axis / max(float(np.linalg.norm(axis)), 1e-9)
    lower = upper = speed = effort = 0.0
    limit = element.find("limit")
    if limit is not None:
        lower, upper, speed, effort = (
            _numbers(limit, key, 1, (0.0,), where)[0] for key in ("lower", "upper", "velocity", "effort")
        )
    if kind == "continuous":
        # It may turn for ever; vita wants finite limits and allows one turn each way.
        lower, upper = -2 * np.pi, 2 * np.pi
    elif kind != "fixed" and not lower < upper:
        raise BadInput(f"needs a <limit> with lower < upper, got {lower} and {upper}", where)
    return UrdfJoint(
        name, kind, parent.get("link") or "", child.get("link") or "", _origin(element, where),
        axis, lower, upper, abs(speed), abs(effort),
    )  # fmt: skip


def _link(element: ET.Element, palette: Mapping[str, tuple[float, float, float]], path: Path) -> UrdfLink:
    name = element.get("name") or "unnamed"
    where = f"{path}: link {name!r}"
    visual = [_geometry(e, palette, path, where) for e in element.findall("visual")]
    collision = [_geometry(e, palette, path, where) for e in element.findall("collision")]
    return UrdfLink(name, tuple(g for g in visual if g), tuple(g for g in collision if g))


def _geometry(
    element: ET.Element, palette: Mapping[str, tuple[float, float, float]], path: Path, where: str
) -> Geometry | None:
    holder = element.find("geometry")
    shape = next(iter(holder), None) if holder is not None else None
    if shape is None:
        return None
    origin, color = _origin(element, where), None
    if (material := element.find("material")) is not None:
        color = _color(material) or palette.get(material.get("name") or "")
    if shape.tag == "box":
        return Geometry("box", tuple(_numbers(shape, "size", 3, None, where)), origin, color)
    if shape.tag in ("cylinder", "capsule"):
        radius, length = (_numbers(shape, key, 1, None, where)[0] for key in ("radius", "length"))
        return Geometry(shape.tag, (radius, length), origin, color)
    if shape.tag == "sphere":
        return Geometry("sphere", tuple(_numbers(shape, "radius", 1, None, where)), origin, color)
    if shape.tag == "mesh":
        scale = tuple(_numbers(shape, "scale", 3, (1.0, 1.0, 1.0), where))
        return Geometry("mesh", scale, origin, color, find_mesh(shape.get("filename") or "", path, where))
    raise BadInput(f"unknown geometry <{shape.tag}>", where)


def find_mesh(filename: str, urdf: Path, where: str) -> Path:
    """The mesh file that a URDF names, relative to it; `package://` is looked for in every folder above."""
    inside = filename.split("://", 1)[-1]
    above = [urdf.resolve().parent, *urdf.resolve().parent.parents]
    if filename.startswith("package://"):
        # The package's name is a folder above the file, or the file lies inside that package.
        short = inside.split("/", 1)[-1]
        candidates = [folder / tail for folder in above for tail in (inside, short)]
    else:
        candidates = [above[0] / inside]
    for candidate in candidates:
        if candidate.is_file():
            return candidate
    raise BadInput(f"mesh {filename!r} was not found beside the URDF or in a folder above it", where)


def with_absolute_meshes(text: str, urdf: Path) -> str:
    """The URDF's text with every `scheme://` mesh replaced by the file that `find_mesh` finds."""

    def located(match: re.Match[str]) -> str:
        return f'filename="{find_mesh(match[2], urdf, str(urdf))}"'

    return re.sub(r"""filename\s*=\s*(["'])([a-z]+://.*?)\1""", located, text)


def _palette(robot: ET.Element) -> dict[str, tuple[float, float, float]]:
    """Named colours: materials may be defined once and used by name anywhere."""
    found = {}
    for material in robot.iter("material"):
        if (color := _color(material)) is not None:
            found.setdefault(material.get("name") or "", color)
    return found


def _color(material: ET.Element) -> tuple[float, float, float] | None:
    element = material.find("color")
    if element is None:
        return None
    r, g, b, _ = _numbers(element, "rgba", 4, (*GREY, 1.0), "material")
    return r, g, b


def _origin(element: ET.Element, where: str) -> Array:
    """(4, 4) of an <origin xyz rpy>: Rz(yaw) Ry(pitch) Rx(roll)."""
    T = np.eye(4)
    origin = element.find("origin")
    if origin is None:
        return T
    roll, pitch, yaw = _numbers(origin, "rpy", 3, (0.0, 0.0, 0.0), where)
    x, y, z = np.eye(3)
    T[:3, :3] = rotation_about(z, yaw) @ rotation_about(y, pitch) @ rotation_about(x, roll)
    T[:3, 3] = _numbers(origin, "xyz", 3, (0.0, 0.0, 0.0), where)
    return T


def _numbers(
    element: ET.Element, key: str, count: int, default: tuple[float, ...] | None, where: str
) -> tuple[float, ...]:
    text = element.get(key)
    if text is None and default is not None:
        return default
    try:
        values = tuple(float(word) for word in (text or "").split())
    except ValueError:
        values = ()
    if len(values) != count or not np.isfinite(values).all():
        raise BadInput(f"<{element.tag} {key}={text!r}> needs {count} finite number(s)", where)
    return values
