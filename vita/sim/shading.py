"""Vertex normals that are smooth on round parts and sharp at edges."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from vita.types import Array


def shaded(
    vertices: Array, faces: NDArray[np.int32], edge_deg: float = 38.0
) -> tuple[Array, NDArray[np.int32], Array]:
    """Vertices, faces and normals in which vertices on sharp edges are doubled.

    Each face corner takes the area-weighted mean of those faces around its vertex that are tilted
    by less than `edge_deg` against its own face. Faces without area are dropped.
    """
    # Vertices at the same place count as one, or every seam would be an edge.
    _, first, merged = np.unique(np.round(vertices, 7), axis=0, return_index=True, return_inverse=True)
    vertices = np.asarray(vertices, dtype=float)[first]
    faces = merged.reshape(-1)[faces].reshape(-1, 3).astype(np.int32)
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    areas = np.cross(b - a, c - a)
    size = np.linalg.norm(areas, axis=1)
    faces, areas, size = faces[size > 1e-12], areas[size > 1e-12], size[size > 1e-12]
    flat = areas / size[:, None]

    corner_vertex = faces.reshape(-1)
    corner_face = np.repeat(np.arange(len(faces)), 3)
    at = sparse.csr_matrix(
        (np.ones(len(corner_vertex)), (np.arange(len(corner_vertex)), corner_vertex)),
        shape=(len(corner_vertex), len(vertices)),
    )
    pairs = (at @ at.T).tocoo()
    mine, other = corner_face[pairs.row], corner_face[pairs.col]
    alike = np.einsum("ij,ij->i", flat[mine], flat[other]) > np.cos(np.radians(edge_deg))
    shared = sparse.csr_matrix((pairs.data[alike], (pairs.row[alike], pairs.col[alike])), shape=pairs.shape)
    normals = shared @ areas[corner_face]
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)

    # Vertex and normal (in thousandths) packed into one integer: sorting those is quick.
    key = corner_vertex.astype(np.int64)
    for axis in range(3):
        key = key * 2048 + np.rint(normals[:, axis] * 1000).astype(np.int64) + 1000
    _, keep, index = np.unique(key, return_index=True, return_inverse=True)
    new_faces = index.reshape(-1, 3).astype(np.int32)
    return vertices[corner_vertex[keep]], new_faces, normals[keep]
