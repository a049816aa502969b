"""Assignment of points to points within a radius, image by image."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

F64 = npt.NDArray[np.float64]
I64 = npt.NDArray[np.int64]


class Pairs(NamedTuple):
    """Pairs of points of one image that lie within the radius of each other."""

    left: I64
    """Row of the first point of each pair, (n,)."""
    right: I64
    distance_px: F64

    def where(self, chosen: npt.NDArray[np.bool_ | np.signedinteger]) -> Pairs:
        """Some of the pairs, by flags or numbers."""
        return Pairs(self.left[chosen], self.right[chosen], self.distance_px[chosen])


def near_pairs(left_image: I64, left_px: F64, right_image: I64, right_px: F64, radius_px: float) -> Pairs:
    """Find all pairs of points of the same image that are no farther apart than a radius.

    Args:
        left_image: Numbers of the images, (n,).
        left_px: Finite positions, (n, 2).
        right_image: As `left_image`, (m,).
        right_px: As `left_px`, (m, 2).
        radius_px: Largest distance, included.
    """
    from scipy.spatial import KDTree

    if not (len(left_px) and len(right_px)):
        nothing = np.zeros(0, dtype=np.int64)
        return Pairs(nothing, nothing, np.zeros(0))
    apart = 4.0 * radius_px  # images are planes of one space, none within reach of another
    trees = [KDTree(np.c_[px, apart * image]) for image, px in ((left_image, left_px), (right_image, right_px))]
    found = trees[0].sparse_distance_matrix(trees[1], radius_px, output_type="ndarray")
    order = np.lexsort((found["j"], found["i"]))
    return Pairs(found["i"][order].astype(np.int64), found["j"][order].astype(np.int64), found["v"][order])


def assign(pairs: Pairs, n_left: int, n_right: int) -> I64:
    """Assign points one to one: as many as can be, and of these ways the one with the least sum of distances.

    Returns:
        For each left point the row of its right one, -1 for none, (n_left,).
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    partner = np.full(n_left, -1, dtype=np.int64)
    if not len(pairs.left):
        return partner
    size = n_left + n_right
    graph = coo_array((np.ones(len(pairs.left)), (pairs.left, n_left + pairs.right)), shape=(size, size))
    _, label = connected_components(graph, directed=False)
    group = label[pairs.left]
    single = np.bincount(group)[group] == 1
    partner[pairs.left[single]] = pairs.right[single]
    order = np.flatnonzero(~single)
    order = order[np.argsort(group[order], kind="stable")]
    for rows in np.split(order, np.flatnonzero(np.diff(group[order])) + 1):
        _assign_group(pairs.where(rows), partner)
    return partner


def _assign_group(pairs: Pairs, partner: I64) -> None:
    """Assign the points of pairs that hang together."""
    from scipy.optimize import linear_sum_assignment

    if not len(pairs.left):
        return
    left, row = np.unique(pairs.left, return_inverse=True)
    right, col = np.unique(pairs.right, return_inverse=True)
    none = 1.0 + 2.0 * pairs.distance_px.max() * min(len(left), len(right))  # more than any assignment costs
    cost = np.full((len(left), len(right)), none)
    cost[row, col] = pairs.distance_px
    rows, cols = linear_sum_assignment(cost)
    taken = cost[rows, cols] < none
    partner[left[rows[taken]]] = right[cols[taken]]
