"""Areas of meshes: bodies of flat facets, and of every kind of body where the kind is known on the device only.

The meshes of a scene share one list of facets. Where a facet lies does not matter, only its normal and its area: facets
do not hide or shade each other, which is exact for convex bodies and too large for others.
"""

import warp as wp

from warpsim_kernels.shapes import Body, projected_area_m2, reflected_area_m2


@wp.struct
class Facets:
    """Flat facets of all meshes, one mesh behind the other."""

    normal: wp.array[wp.vec3d]  # (n_facet,) unit, outward, body axes
    area_m2: wp.array[wp.float64]  # (n_facet,)


@wp.func
def facets_projected_area_m2(facets: Facets, first: int, count: int, view: wp.vec3d) -> wp.float64:
    """Sum of area * max(0, n.view) over facets first to first + count - 1 [m2]; view: unit, body axes."""
    zero = wp.float64(0.0)
    total = wp.float64(0.0)
    for i in range(first, first + count):
        total += facets.area_m2[i] * wp.max(wp.dot(facets.normal[i], view), zero)
    return total


@wp.func
def facets_reflected_area_m2(facets: Facets, first: int, count: int, view: wp.vec3d, sun: wp.vec3d) -> wp.float64:
    """Sum of area * max(0, n.view) * max(0, n.sun) over facets [m2]; unit vectors in body axes."""
    zero = wp.float64(0.0)
    total = wp.float64(0.0)
    for i in range(first, first + count):
        normal = facets.normal[i]
        total += facets.area_m2[i] * wp.max(wp.dot(normal, view), zero) * wp.max(wp.dot(normal, sun), zero)
    return total


@wp.func
def body_projected_area_m2(body: Body, facets: Facets, view: wp.vec3d) -> wp.float64:
    """Projected area of a body of any kind [m2]; view: unit, body axes."""
    if body.n_facet > 0:
        return facets_projected_area_m2(facets, body.first_facet, body.n_facet, view)
    return projected_area_m2(body, view[2], wp.sqrt(view[0] * view[0] + view[1] * view[1]))


@wp.func
def body_reflected_area_m2(body: Body, facets: Facets, view: wp.vec3d, sun: wp.vec3d) -> wp.float64:
    """Reflected area of a body of any kind [m2]; unit vectors in body axes."""
    if body.n_facet > 0:
        return facets_reflected_area_m2(facets, body.first_facet, body.n_facet, view, sun)
    return reflected_area_m2(body, view, sun)


@wp.kernel(enable_backward=False)
def projected_area_along_kernel(
    # in
    body: Body,
    facets: Facets,
    view: wp.array[wp.vec3d],  # (n,) unit, body axes
    # out
    area_m2: wp.array[wp.float64],  # (n,)
):
    """Projected area along each direction."""
    i = wp.tid()
    area_m2[i] = body_projected_area_m2(body, facets, view[i])


@wp.kernel(enable_backward=False)
def reflected_area_kernel(
    # in
    body: Body,
    facets: Facets,
    view: wp.array[wp.vec3d],  # (n,) unit, body axes
    sun: wp.array[wp.vec3d],  # (n,) unit, body axes
    # out
    area_m2: wp.array[wp.float64],  # (n,)
):
    """Reflected area of each pair of directions."""
    i = wp.tid()
    area_m2[i] = body_reflected_area_m2(body, facets, view[i], sun[i])
