"""Isosurface of a function on a rectangular grid, by marching tetrahedra."""

import numpy as np

# The six tetrahedra of a cube around its diagonal from corner 0 to corner 7; corner = 4 i + 2 j + k.
TETRAHEDRA = np.array([[0, 7, a, b] for a, b in ((1, 3), (3, 2), (2, 6), (6, 4), (4, 5), (5, 1))])
# Edges that carry the triangles' corners, for tetrahedra whose vertices are sorted inside first.
TRIANGLES = {
    1: [((0, 1), (0, 2), (0, 3))],
    2: [((0, 2), (0, 3), (1, 3)), ((0, 2), (1, 3), (1, 2))],
    3: [((0, 3), (1, 3), (2, 3))],
}


def isosurface(axes: list[np.ndarray], values: np.ndarray) -> np.ndarray:
    """Triangles (n, 3, 3) of the surface values = 0, each counter-clockwise as seen from where values > 0.

    Args:
        axes: three increasing coordinates of lengths l, m, n.
        values: (l, m, n), negative inside.
    """
    corners, inside = _tetrahedra(axes, values)
    triangles = [np.zeros((0, 3, 3))]
    for count, shapes in TRIANGLES.items():
        chosen = inside.sum(axis=1) == count
        points, order = corners[chosen], np.argsort(~inside[chosen], axis=1, kind="stable")
        points = np.take_along_axis(points, order[:, :, None], axis=1)
        outward = points[:, count:, :3].mean(axis=1) - points[:, :count, :3].mean(axis=1)
        for edges in shapes:
            triangles.append(_facing(np.stack([_crossing(points, a, b) for a, b in edges], axis=1), outward))
    return np.concatenate(triangles)


def _tetrahedra(axes: list[np.ndarray], values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Corners (n, 4, 4) = (point, value) of the tetrahedra that the surface crosses, and which are inside."""
    grid = np.concatenate([np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1), values[..., None]], axis=-1)
    near, far = slice(None, -1), slice(1, None)
    cubes = np.stack(
        [grid[i, j, k] for i in (near, far) for j in (near, far) for k in (near, far)], axis=-2
    ).reshape(-1, 8, 4)
    negative = cubes[:, :, 3] < 0.0
    cubes = cubes[negative.any(axis=1) & ~negative.all(axis=1)]
    corners = cubes[:, TETRAHEDRA].reshape(-1, 4, 4)
    return corners, corners[:, :, 3] < 0.0


def _crossing(points: np.ndarray, a: int, b: int) -> np.ndarray:
    """Where the value is zero on the edges from vertex a to vertex b, (n, 3)."""
    low, high = points[:, a], points[:, b]
    part = low[:, 3:] / (low[:, 3:] - high[:, 3:])
    return np.asarray(low[:, :3] + part * (high[:, :3] - low[:, :3]))


def _facing(triangles: np.ndarray, outward: np.ndarray) -> np.ndarray:
    """The triangles, turned so that their normals point along `outward`."""
    normal = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    wrong = np.einsum("ni,ni->n", normal, outward) < 0.0
    triangles[wrong] = triangles[wrong][:, ::-1]
    return triangles
