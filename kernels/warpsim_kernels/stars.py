"""Stage gather_stars: the stars of each view, from the index to the focal plane."""

import warp as wp

from warpsim_kernels.apparent import aberrated
from warpsim_kernels.band_index import cone_cover, run_begin, run_end
from warpsim_kernels.camera import Camera, depth, projected_px, within_frame
from warpsim_kernels.earth import Earth, is_star_occulted


@wp.struct
class StarCone:
    """What the star query of a scene's camera needs besides the boresight."""

    radius_rad: wp.float64  # half diagonal, plus the widest stamp, plus the largest aberration
    cosine: wp.float64  # of radius_rad
    with_aberration: int


@wp.kernel(enable_backward=False)
def gather_stars_kernel(
    # in
    view_axes: wp.array[wp.mat33d],  # (n_view,)
    view_position_m: wp.array[wp.vec3d],  # (n_view,) geocentric
    view_velocity_m_s: wp.array[wp.vec3d],  # (n_view,) barycentric
    cell_start: wp.array[wp.int32],  # (180 * 360 + 1,)
    star_direction: wp.array[wp.vec3d],  # (n_star,) ICRS, in cell order
    star_irradiance_w_cm2: wp.array2d[float],  # (n_band, n_star) in cell order
    star_half_width_px: wp.array[wp.int32],  # (n_star,) widest stamp over the bands
    camera: Camera,
    cone: StarCone,
    earth: Earth,
    n_target: int,  # slots already taken by targets
    # out
    source_xy_px: wp.array2d[wp.vec2d],  # (n_view, n_slot)
    source_irradiance_w_cm2: wp.array3d[float],  # (n_view, n_band, n_slot)
    source_star: wp.array2d[wp.int32],  # (n_view, n_slot) star in cell order, -1 for a target
    n_source: wp.array[wp.int32],  # (n_view,) filled slots
    n_wanted: wp.array[wp.int32],  # (n_view,) slots needed; above n_slot when the list is full
):
    """Append every star in front of the Earth whose stamp touches the frame, in cell order; one thread per view."""
    view = wp.tid()
    axes = view_axes[view]
    boresight = wp.vec3d(axes[2, 0], axes[2, 1], axes[2, 2])
    n_band = source_irradiance_w_cm2.shape[1]
    n_slot = source_xy_px.shape[1]
    n = int(n_target)
    for target in range(n_target):
        source_star[view, target] = -1
    cover = cone_cover(boresight, cone.radius_rad)
    for band in range(cover.first_band, cover.last_band + 1):
        for part in range(2):
            for star in range(run_begin(cell_start, band, cover, part), run_end(cell_start, band, cover, part)):
                catalog_direction = star_direction[star]
                inside = wp.dot(catalog_direction, boresight) >= cone.cosine
                if inside and not is_star_occulted(view_position_m[view], catalog_direction, earth):
                    direction = catalog_direction
                    if cone.with_aberration != 0:
                        direction = aberrated(direction, view_velocity_m_s[view])
                    xy_px = projected_px(camera, axes, direction)
                    in_front = depth(axes, direction) > wp.float64(0.0)
                    if in_front and within_frame(camera, xy_px, wp.float64(star_half_width_px[star])):
                        if n < n_slot:
                            source_xy_px[view, n] = xy_px
                            source_star[view, n] = star
                            for channel in range(n_band):
                                source_irradiance_w_cm2[view, channel, n] = star_irradiance_w_cm2[channel, star]
                        n += 1
    n_wanted[view] = n
    n_source[view] = wp.min(n, n_slot)
