"""Turns the geometry of a URDF into drawable meshes."""

from __future__ import annotations

import warnings
from collections.abc import Sequence

import numpy as np
import trimesh

from vita.errors import BadInput, MissingDependency
from vita.sim.shading import shaded
from vita.sim.shapes import Solid, ball, drum, slab
from vita.sim.urdf import GREY, Geometry, Urdf
from vita.types import Visual, frozen


def urdf_visuals(urdf: Urdf, bodies: dict[str, str]) -> tuple[Visual, ...]:
    """The visuals of every link; `bodies` maps link names to body names.

    A link whose visual meshes cannot be read (a Collada file without pycollada, say) is drawn by
    its collision geometry, with a warning, so that the robot can still be used.
    """
    drawn: list[Visual] = []
    for link in urdf.links.values():
        body = bodies.get(link.name, link.name)
        try:
            drawn += _drawn(body, link.visual)
        except (BadInput, MissingDependency) as reason:
            warnings.warn(f"link {link.name!r} is drawn by its collision shape: {reason}", stacklevel=2)
            try:
                drawn += _drawn(body, link.collision)
            except (BadInput, MissingDependency) as again:
                warnings.warn(f"link {link.name!r} is not drawn: {again}", stacklevel=2)
    return tuple(drawn)


def visual(body: str, solid: Solid, color: tuple[float, float, float]) -> Visual:
    """A solid as a `Visual` with smooth normals and sharp edges."""
    vertices, faces, normals = shaded(solid.vertices, solid.faces)
    return Visual(body, frozen(vertices), frozen(faces, np.int32), frozen(normals), color)


def _drawn(body: str, shapes: Sequence[Geometry]) -> list[Visual]:
    return [v for shape in shapes for v in _shape_visuals(body, shape)]


def _shape_visuals(body: str, shape: Geometry) -> list[Visual]:
    if shape.kind == "mesh":
        return _mesh_visuals(body, shape)
    return [visual(body, primitive(shape).moved(shape.origin), shape.color or GREY)]


def primitive(shape: Geometry) -> Solid:
    """A box, cylinder, capsule or sphere of a URDF as a solid in its own frame."""
    if shape.kind == "box":
        x, y, z = np.array(shape.size) / 2
        return slab(np.array([[x, y], [-x, y], [-x, -y], [x, -y]]), -z, z, edge=0.0)
    if shape.kind == "sphere":
        return ball(shape.size[0])
    radius, length = shape.size
    if shape.kind == "cylinder":
        return drum(radius, -length / 2, length / 2, edge=0.02 * min(radius, length))
    upper = ball(radius).vertices
    stretched = upper + np.where(upper[:, 2:] > 0, 0.5, -0.5) * length * np.array([0, 0, 1])
    return Solid(stretched, ball(radius).faces)


def _mesh_visuals(body: str, shape: Geometry) -> list[Visual]:
    """A mesh file, one `Visual` for each of its parts.

    Normals are computed anew: many files have none, and the edges are then treated alike everywhere.
    """
    drawn = []
    for part in _read_mesh(shape):
        faces = np.asarray(part.faces, dtype=np.int32)
        if np.prod(shape.size) < 0:  # a mirrored mesh is inside out
            faces = faces[:, ::-1]
        solid = Solid(np.asarray(part.vertices, dtype=float) * np.array(shape.size), faces)
        drawn.append(visual(body, solid.moved(shape.origin), shape.color or _own_color(part)))
    return drawn


def _own_color(part: trimesh.Trimesh) -> tuple[float, float, float]:
    """The colour that a mesh file gives, grey where it gives none or a texture."""
    material = getattr(part.visual, "material", None)
    if material is None or getattr(material, "image", None) is not None:
        return GREY
    r, g, b = (float(level) / 255 for level in material.main_color[:3])
    return r, g, b


def _read_mesh(shape: Geometry) -> list[trimesh.Trimesh]:
    """The triangle meshes of a file, in the file's own frame."""
    path = shape.mesh
    try:
        loaded = trimesh.load_scene(str(path), process=False)
        parts = [part for part in loaded.dump() if isinstance(part, trimesh.Trimesh)]
    except ImportError as reason:
        raise MissingDependency(f"mesh {path} needs the Python package {reason.name}") from reason
    except Exception as reason:  # trimesh's readers raise whatever a broken file makes them raise
        raise BadInput(f"not a readable mesh: {reason}", str(path)) from reason
    parts = [part for part in parts if len(part.faces) and np.isfinite(part.vertices).all()]
    if not parts:
        raise BadInput("the mesh has no triangles", str(path))
    return parts
