"""Stage gather_stars: the stars of each view, from the index to the focal plane."""

import functools
import math
from typing import NamedTuple

import warp as wp

from warpsim_kernels.apparent import Boost, boost_by, boosted, deflected, seen_from
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
    parallax_rad: wp.array[float]  # (n_star,); empty where parallax is disabled
    radius_rad: wp.float64  # of the cone to search: half diagonal, widest stamp, largest shift of apparent positions
    cosine: wp.float64  # of radius_rad


@wp.struct
class EarthOrbit:
    """Positions of the Earth at the nodes of the tracks; ICRS axes."""

    barycentric_m: wp.array[wp.vec3d]  # (n_node,)
    heliocentric_m: wp.array[wp.vec3d]  # (n_node,)
    grid: NodeGrid


@wp.struct
class SkyView:
    """The part of a view that decides which stars it sees, and where."""

    axes: wp.mat33d
    position_m: wp.vec3d  # geocentric
    boresight: wp.vec3d
    observer_m: wp.vec3d  # barycentric; read where parallax is on
    from_sun_m: wp.vec3d  # heliocentric; read where deflection is on
    boost: Boost
    radius_rad: wp.float64  # of the cone to search
    cosine: wp.float64  # of radius_rad
    reach_px: wp.float64  # how far stars move during the exposure
    at_limb: bool  # whether the Earth may hide stars of the cone


@wp.struct
class ApparentStar:
    """A star as a view sees it."""

    in_view: bool
    xy_px: wp.vec2d
    direction: wp.vec3d


class StarFeatures(NamedTuple):
    """Features of the kernel of the stage."""

    parallax: bool = False
    deflection: bool = False
    aberration: bool = False
    distortion: bool = False
    streaks: bool = False


@functools.cache
def make_star_functions(features: StarFeatures) -> tuple[wp.Function, wp.Function]:
    """Functions that find what decides about the stars of a view, and a star as the view sees it."""
    projected_px = projection(features.distortion)

    @wp.func
    def sky_view(camera_at: View, time_s: wp.float64, stars: StarField, orbit: EarthOrbit, earth: Earth) -> SkyView:
        view = SkyView()
        view.axes = camera_at.axes
        view.position_m = camera_at.position_m
        view.boresight = wp.vec3d(view.axes[2, 0], view.axes[2, 1], view.axes[2, 2])
        if wp.static(features.parallax):
            view.observer_m = linear_vector(orbit.barycentric_m, time_s, orbit.grid) + camera_at.position_m
        if wp.static(features.deflection):
            view.from_sun_m = linear_vector(orbit.heliocentric_m, time_s, orbit.grid) + camera_at.position_m
        view.radius_rad = stars.radius_rad
        view.cosine = stars.cosine
        if wp.static(features.streaks):
            view.reach_px = camera_at.reach[0]
            view.radius_rad = wp.min(stars.radius_rad + camera_at.reach[1], wp.float64(wp.static(math.pi)))
            view.cosine = wp.cos(view.radius_rad)
        view.boost = boost_by(camera_at.velocity_m_s)
        view.at_limb = is_earth_near(view.position_m, view.boresight, view.radius_rad, earth)
        return view

    @wp.func
    def apparent_star(star: int, view: SkyView, stars: StarField, camera: Camera, earth: Earth) -> ApparentStar:
        result = ApparentStar()
        result.in_view = False
        seen = stars.direction[star]
        if wp.dot(seen, view.boresight) < view.cosine:
            return result
        if view.at_limb:
            if is_star_occulted(view.position_m, seen, earth):
                return result
        if wp.static(features.parallax):
            seen = seen_from(seen, wp.float64(stars.parallax_rad[star]), view.observer_m)
        if wp.static(features.deflection):
            seen = deflected(seen, view.from_sun_m)
        if wp.static(features.aberration):
            seen = boosted(seen, wp.float64(1.0), view.boost)
        if depth(view.axes, seen) <= wp.float64(0.0):
            return result
        result.xy_px = projected_px(camera, view.axes, seen)
        result.direction = seen
        margin_px = wp.float64(stars.half_width_px[star]) + view.reach_px
        result.in_view = within_frame(camera, result.xy_px, margin_px)
        return result

    return sky_view, apparent_star


@functools.cache
def make_gather_stars_kernel(features: StarFeatures, n_thread: int) -> wp.Kernel:
    """Kernel of the stage, for blocks of n_thread threads, one block per view, without disabled features."""
    sky_view, apparent_star = make_star_functions(features)

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
        views: wp.array[View],  # (n_view,) n_required
        sources: Sources,  # all but offset_px
    ):
        """Append every star in front of the Earth whose stamp touches the frame, in cell order."""
        view, thread = wp.tid()
        sky = sky_view(views[view], view_time_s[view], stars, orbit, earth)
        n_slot = sources.xy_px.shape[1]
        n = int(n_target)
        for target in range(thread, n_target, n_thread):
            sources.star[view, target] = -1
        cover = cone_cover(sky.boresight, sky.radius_rad)
        for band in range(cover.first_band, cover.last_band + 1):
            for part in range(2):
                run = run_of_stars(stars.cell_start, stars.direction, band, cover, part)
                for first in range(run[0], run[1], n_thread):
                    star = first + thread
                    seen = ApparentStar()
                    if star < run[1]:
                        seen = apparent_star(star, sky, stars, camera, earth)
                    slot = n
                    if wp.static(n_thread > 1):  # those of the threads before come first
                        ranks = wp.tile_scan_inclusive(wp.tile(int(seen.in_view)))
                        slot += wp.untile(ranks) - 1
                        n += wp.tile_extract(ranks, wp.static(n_thread - 1))
                    if seen.in_view:
                        if slot < n_slot:
                            sources.xy_px[view, slot] = seen.xy_px
                            sources.star[view, slot] = star
                            if wp.static(features.streaks):
                                sources.direction[view, slot] = wp.normalize(seen.direction)
                            for channel in range(sources.irradiance_w_cm2.shape[1]):
                                sources.irradiance_w_cm2[view, channel, slot] = stars.irradiance_w_cm2[channel, star]
                        if wp.static(n_thread == 1):
                            n += 1
        if thread == 0:
            views[view].n_required = n
            sources.n_source[view] = wp.min(n, n_slot)

    return gather_stars_kernel
