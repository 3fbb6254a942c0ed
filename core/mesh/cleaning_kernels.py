"""Loops over the faces of a mesh: which corners hang together, how large parts are, and which faces are kept."""

from __future__ import annotations

import math

from ..compiled import inlined, kernel


@inlined
def _first_of(parents, corner):  # type: ignore[no-untyped-def]
    """The corner that stands for all that one hangs together with; the way there becomes shorter."""
    while parents[corner] != corner:
        parents[corner] = parents[parents[corner]]
        corner = parents[corner]
    return corner


@kernel
def join_corners(begin, end, faces, parents):  # type: ignore[no-untyped-def]
    """Joins the corners of each face (union-find, Tarjan 1975); for one thread.

    Args:
        faces: [M, 3]; parents: [N] int32, each its own before; output: one nearer to the first of the part.
    """
    for face in range(begin, end):
        one = _first_of(parents, faces[face, 0])
        for k in range(1, 3):
            other = _first_of(parents, faces[face, k])
            one, other = min(one, other), max(one, other)
            parents[other] = one


@kernel
def sum_areas(begin, end, faces, vertices, parents, areas):  # type: ignore[no-untyped-def]
    """Adds the areas of faces to those of their parts; for one thread.

    Args:
        faces: [M, 3]; vertices: [N, 3] float64; parents: [N] int32 of `join_corners`.
        areas: [N] float64 output, at the first corner of each part.
    """
    for face in range(begin, end):
        a, b, c = vertices[faces[face, 0]], vertices[faces[face, 1]], vertices[faces[face, 2]]
        ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
        vx, vy, vz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
        x, y, z = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        areas[_first_of(parents, faces[face, 0])] += 0.5 * math.sqrt(x * x + y * y + z * z)


@kernel
def keep_parts(begin, end, faces, parents, areas, least, kept):  # type: ignore[no-untyped-def]
    """Copies the faces of parts that are large enough; for one thread.

    Args:
        faces: [M, 3] int64; parents, areas: [N] of `sum_areas`; least: area.
        kept: [M, 3] int64 output, as many rows as are kept.

    Returns:
        how many those are.
    """
    count = 0
    for face in range(begin, end):
        if areas[_first_of(parents, faces[face, 0])] >= least:
            kept[count, 0], kept[count, 1], kept[count, 2] = faces[face, 0], faces[face, 1], faces[face, 2]
            count += 1
    return count


@kernel
def weld_faces(begin, end, faces, index, welded):  # type: ignore[no-untyped-def]
    """Gives faces other corners, and leaves out those that lose one of three; for one thread.

    Args:
        faces: [M, 3]; index: [N] int64, what each corner becomes.
        welded: [M, 3] int64 output, as many rows as are left.

    Returns:
        how many those are.
    """
    count = 0
    for face in range(begin, end):
        a, b, c = index[faces[face, 0]], index[faces[face, 1]], index[faces[face, 2]]
        if a != b and b != c and c != a:
            welded[count, 0], welded[count, 1], welded[count, 2] = a, b, c
            count += 1
    return count


@kernel
def mark_corners(begin, end, faces, has):  # type: ignore[no-untyped-def]
    """Marks the corners that faces have; threads may mark the same one, with the same mark.

    Args:
        faces: [M, 3]; has: [N] bool, false before; output.
    """
    for face in range(begin, end):
        for k in range(3):
            has[faces[face, k]] = True


@kernel
def renumber_corners(begin, end, faces, places):  # type: ignore[no-untyped-def]
    """Gives the corners of faces other numbers.

    Args:
        faces: [M, 3] int64, in place; places: [N] int64, the number of each.
    """
    for face in range(begin, end):
        for k in range(3):
            faces[face, k] = places[faces[face, k]]
