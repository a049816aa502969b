"""Bodies written out on their own: directions, ends, facets, boxes, and how rows of truth see them."""

from __future__ import annotations

import numpy as np

CORNERS = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
"""Of a cube of 1 m about the origin."""
QUADS = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
TRIANGLES = np.array([face for a, b, c, d in QUADS for face in ([a, b, c], [a, c, d])])


def unit_vectors(seed, *shape):
    """Random directions, (*shape, 3)."""
    vectors = np.random.default_rng(seed).normal(size=(*shape, 3))
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def ends_m(shape):
    """Radii of base and top of a cylinder, cone or frustum, and its height."""
    top = {"cylinder": shape.radius_m, "cone": 0.0}.get(shape.kind, getattr(shape, "top_radius_m", None))
    return shape.radius_m, top, shape.height_m


def facets(shape, n, n_ring=None):
    """Normals (k, 3) and areas (k,): n flat strips around a side and two ends, or rings of n cells of a sphere."""
    turn = (np.arange(n) + 0.5) * 2 * np.pi / n
    if shape.kind == "sphere":
        z, weight = np.polynomial.legendre.leggauss(n_ring or n // 2)
        ring = np.sqrt(1 - z * z)
        x, y = np.outer(ring, np.cos(turn)), np.outer(ring, np.sin(turn))
        normal = np.stack([x, y, np.broadcast_to(z[:, None], x.shape)], axis=-1).reshape(-1, 3)
        return normal, np.repeat(weight, n) * 2 * np.pi / n * shape.radius_m**2
    ends = [[0, 0, 1.0], [0, 0, -1.0]]
    if shape.kind == "plate":
        return np.array(ends), np.full(2, shape.width_m * shape.length_m)
    base, top, height = ends_m(shape)
    slant = np.hypot(height, base - top)
    side = np.stack([height * np.cos(turn), height * np.sin(turn), np.full(n, base - top)], axis=1) / slant
    areas = np.concatenate([np.full(n, np.pi * (base + top) * slant / n), [np.pi * top**2, np.pi * base**2]])
    return np.concatenate([side, ends]), areas


def emission_s(rows):
    """When the light of rows of truth left."""
    return np.array(rows["time_s"] - rows["range_km"] * 1e3 / 299_792_458.0)


def sight_m(scene, target, row):
    """Place of a target when the light of a row of truth left, and the way from there to the sensor."""
    place_m = scene.position_m(target, [emission_s(row)])[0]
    return place_m, scene.position_m(row["sensor"], [row["time_s"]])[0] - place_m


def ground_m(up, pole):
    """Radius of the ellipsoid along a direction from the Earth's centre."""
    sine2 = (up @ pole) ** 2
    return 1 / np.sqrt((1 - sine2) / 6_378_137.0**2 + sine2 / 6_356_752.314245**2)


def aspects_rad(scene, target, rows):
    """Angles between a target's axis, when the light left, and the sight to the sensors of its rows of truth."""
    observer = np.stack([scene.position_m(row["sensor"], row["time_s"])[0] for row in rows])
    sight = observer - scene.position_m(target, emission_s(rows))
    axis = scene.scenario.body_axis(target, emission_s(rows))
    return np.arctan2(np.linalg.norm(np.cross(axis, sight), axis=1), np.sum(axis * sight, axis=1))
