"""Stage gather_stars: the stars of each view, from the index to the focal plane."""

import functools
import math

import warp as wp

from warpsim_kernels.apparent import boost_by, boosted, deflected, seen_from
from warpsim_kernels.band_index import cone_cover, run_of_stars
from warpsim_kernels.camera import Camera, depth, projection, within_frame
from warpsim_kernels.earth import Earth, is_earth_near, is_star_occulted
from warpsim_kernels.motion import NodeGrid, linear_vector
from warpsim_kernels.records import Sources, View


@wp.struct
class StarField:
    """The star catalog on the device; stars in cell order."""

    cell_start: wp.array[wp.int32]  # (180 * 360 + 1,)
    direction: wp.array[wp.vec3d]  # (n_star,) ICRS
    irradiance_w_cm2: wp.array2d[float]  # (n_band, n_star)
    half_width_px: wp.array[wp.int32]  # (n_star,) widest stamp over the bands
    parallax_rad: wp.array[float]  # (n_star,); empty where parallax is off
    radius_rad: wp.float64  # of the cone to search: half diagonal, widest stamp, largest shift of apparent places
    cosine: wp.float64  # of radius_rad


@wp.struct
class EarthOrbit:
    """Where the Earth is, at the nodes of the tracks; ICRS axes."""

    barycentric_m: wp.array[wp.vec3d]  # (n_node,)
    heliocentric_m: wp.array[wp.vec3d]  # (n_node,)
    grid: NodeGrid


@functools.cache
def make_gather_stars_kernel(
    with_parallax: bool,
    with_deflection: bool,
    with_aberration: bool,
    with_distortion: bool = False,
    with_streaks: bool = False,
) -> wp.Kernel:
    """Kernel of the stage; what is off is not in its code."""
    projected_px = projection(with_distortion)

    @wp.kernel(module="unique", enable_backward=False)
    def gather_stars_kernel(
        # in
        view_time_s: wp.array[wp.float64],  # (n_view,)
        stars: StarField,
        orbit: EarthOrbit,
        camera: Camera,
        earth: Earth,
        n_target: int,  # slots already taken by targets
        # in and out
        views: wp.array[View],  # (n_view,) n_wanted
        sources: Sources,  # all but offset_px
    ):
        """Append every star in front of the Earth whose stamp touches the frame, in cell order; one thread per view."""
        view = wp.tid()
        camera_at = views[view]
        axes = camera_at.axes
        boresight = wp.vec3d(axes[2, 0], axes[2, 1], axes[2, 2])
        observer_m = wp.vec3d()
        from_sun_m = wp.vec3d()
        if wp.static(with_parallax):
            observer_m = linear_vector(orbit.barycentric_m, view_time_s[view], orbit.grid) + camera_at.position_m
        if wp.static(with_deflection):
            from_sun_m = linear_vector(orbit.heliocentric_m, view_time_s[view], orbit.grid) + camera_at.position_m
        n_slot = sources.xy_px.shape[1]
        n = int(n_target)
        for target in range(n_target):
            sources.star[view, target] = -1
        radius_rad = stars.radius_rad
        cosine = stars.cosine
        reach_px = wp.float64(0.0)
        if wp.static(with_streaks):
            reach_px = camera_at.reach[0]
            radius_rad = wp.min(radius_rad + camera_at.reach[1], wp.float64(wp.static(math.pi)))
            cosine = wp.cos(radius_rad)
        boost = boost_by(camera_at.velocity_m_s)
        at_limb = is_earth_near(camera_at.position_m, boresight, radius_rad, earth)
        cover = cone_cover(boresight, radius_rad)
        for band in range(cover.first_band, cover.last_band + 1):
            for part in range(2):
                run = run_of_stars(stars.cell_start, stars.direction, band, cover, part)
                for star in range(run[0], run[1]):
                    seen = stars.direction[star]
                    if wp.dot(seen, boresight) < cosine:
                        continue
                    if at_limb:
                        if is_star_occulted(camera_at.position_m, seen, earth):
                            continue
                    if wp.static(with_parallax):
                        seen = seen_from(seen, wp.float64(stars.parallax_rad[star]), observer_m)
                    if wp.static(with_deflection):
                        seen = deflected(seen, from_sun_m)
                    if wp.static(with_aberration):
                        seen = boosted(seen, wp.float64(1.0), boost)
                    if depth(axes, seen) <= wp.float64(0.0):
                        continue
                    xy_px = projected_px(camera, axes, seen)
                    margin_px = wp.float64(stars.half_width_px[star]) + reach_px
                    if not within_frame(camera, xy_px, margin_px):
                        continue
                    if n < n_slot:
                        sources.xy_px[view, n] = xy_px
                        sources.star[view, n] = star
                        if wp.static(with_streaks):
                            sources.direction[view, n] = wp.normalize(seen)
                        for channel in range(sources.irradiance_w_cm2.shape[1]):
                            sources.irradiance_w_cm2[view, channel, n] = stars.irradiance_w_cm2[channel, star]
                    n += 1
        views[view].n_wanted = n
        sources.n_source[view] = wp.min(n, n_slot)

    return gather_stars_kernel
