"""What lies behind sources: smooth light on a coarse grid of nodes per view, and bilinear between them.

Nodes hold what is smooth over the field: the light of the sky per pixel, how high above the ground a line of sight
passes, and how high the Sun stands there.
"""

import functools

import warp as wp

from warpsim_kernels.canvas import STRIP_SHIFT, flags_of_image
from warpsim_kernels.earth_shine import (
    EarthShine,
    SunPath,
    disc_part,
    earth_geometry,
    earth_radiance,
    sun_direction,
    sun_strength,
    turned_back,
)
from warpsim_kernels.records import View
from warpsim_kernels.shared_memory import thread_of_block
from warpsim_kernels.stray_light import (
    StrayLight,
    angle_between,
    earth_cap,
    is_seen,
    moon_position,
    stray_of_earth,
    stray_ratio,
)

RUN = 32
"""Pixels of a row that are added to at once."""

ASTRONOMICAL_UNIT_M = wp.constant(wp.float64(149597870700.0))

SPEED_OF_LIGHT_M_S = wp.constant(wp.float64(299792458.0))


@wp.struct
class SkyPlates:
    """Radiance of the sky on square plates that touch the sphere: gnomonic grids. The first plate of a layer serves."""

    axes: wp.array[wp.mat33d]  # (n_plate,) rows x, y, centre; ICRS
    half_width: wp.array[wp.float64]  # (n_plate,) tangent of the angle from the centre to an edge
    n_side: wp.array[wp.int32]  # (n_plate,) nodes along an edge
    first: wp.array[wp.int32]  # (n_plate,) the first of its values
    layer: wp.array[wp.int32]  # (n_plate,) 0 for the zodiacal light, which goes with the Sun
    radiance_w_cm2_sr: wp.array2d[float]  # (n_band, n_value) row after row of each plate


@wp.struct
class Background:
    """What the stage reads of the scene."""

    direction: wp.array[wp.vec3d]  # (n_node,) camera axes
    pixel_sr: wp.array[float]  # (n_node,) solid angle of a pixel
    n_across: int
    n_down: int
    step_px: int
    plates: SkyPlates
    sun: SunPath
    earth: EarthShine
    stray: StrayLight


@wp.func
def plate_radiance(plates: SkyPlates, plate: int, band: int, seen: wp.vec3d) -> float:
    """Radiance at a position on a plate, bilinear; `seen` is in its axes [W/cm2/sr]."""
    n = plates.n_side[plate]
    scale = wp.float64(n - 1) / (wp.float64(2.0) * plates.half_width[plate])
    x = (seen[0] / seen[2] + plates.half_width[plate]) * scale
    y = (seen[1] / seen[2] + plates.half_width[plate]) * scale
    col, row = wp.clamp(int(x), 0, n - 2), wp.clamp(int(y), 0, n - 2)
    u, v = float(x - wp.float64(col)), float(y - wp.float64(row))
    at = plates.first[plate] + row * n + col
    light = plates.radiance_w_cm2_sr[band]
    return wp.lerp(wp.lerp(light[at], light[at + 1], u), wp.lerp(light[at + n], light[at + n + 1], u), v)


@wp.func
def sky_radiance(plates: SkyPlates, band: int, direction: wp.vec3d, sunward: wp.vec3d) -> float:
    """Radiance of the sky in a direction [W/cm2/sr]; `sunward` is that direction relative to the Sun."""
    total = float(0.0)
    done = int(-1)
    for plate in range(plates.layer.shape[0]):
        if plates.layer[plate] != done:
            looked = direction
            if plates.layer[plate] == 0:
                looked = sunward
            seen = plates.axes[plate] * looked
            edge = seen[2] * plates.half_width[plate]
            if edge > wp.float64(0.0) and wp.abs(seen[0]) <= edge and wp.abs(seen[1]) <= edge:
                total += plate_radiance(plates, plate, band, seen)
                done = plates.layer[plate]
    return total


@wp.kernel(module="unique", enable_backward=False)
def stray_light_kernel(
    # in
    time_s: wp.array[wp.float64],  # (n_view,)
    views: wp.array[View],  # (n_view,)
    background: Background,
    # out
    stray_w_cm2_sr: wp.array2d[float],  # (n_view, n_band)
):
    """Add what the optics scatter of the Sun, the Moon and the Earth's disc."""
    view = wp.tid()
    seen = views[view]
    stray, earth = background.stray, background.earth
    position, boresight = seen.position_m, wp.vec3d(seen.axes[2, 0], seen.axes[2, 1], seen.axes[2, 2])
    sun = sun_direction(background.sun, time_s[view])
    from_moon = position - moon_position(stray, background.sun, time_s[view])
    ratio_sun, ratio_moon = float(0.0), float(0.0)
    if is_seen(earth, position, sun):
        ratio_sun = stray_ratio(stray, boresight, sun)
    if is_seen(earth, position, -wp.normalize(from_moon)):
        radii = wp.length(from_moon) / stray.moon_radius_m
        ratio_moon = stray_ratio(stray, boresight, -wp.normalize(from_moon)) / float(radii * radii)
    phase = angle_between(sun * ASTRONOMICAL_UNIT_M + from_moon - position, from_moon)
    index = phase / wp.PI * float(stray.moon_w_cm2.shape[1] - 1)
    node = wp.min(int(index), stray.moon_w_cm2.shape[1] - 2)
    of_earth, strength = wp.vec2(0.0, 0.0), sun_strength(background.sun, time_s[view])
    if stray.earth:
        of_earth = stray_of_earth(stray, earth_cap(earth, position, boresight, sun))
    for band in range(stray_w_cm2_sr.shape[1]):
        disc = earth.disc_w_cm2_sr[band]
        of_moon = wp.lerp(stray.moon_w_cm2[band, node], stray.moon_w_cm2[band, node + 1], index - float(node))
        bodies = ratio_sun * strength * stray.sun_w_cm2[band] + ratio_moon * of_moon
        stray_w_cm2_sr[view, band] = bodies + of_earth[0] * disc[0] + of_earth[1] * strength * disc[1]


@functools.cache
def make_background_nodes_kernel(earth: bool, stray: bool) -> wp.Kernel:
    """Kernel over views and nodes: the light of the sky per pixel, and where lines of sight pass the Earth."""

    @wp.kernel(module="unique", enable_backward=False)
    def background_nodes_kernel(
        # in
        time_s: wp.array[wp.float64],  # (n_view,)
        views: wp.array[View],  # (n_view,)
        background: Background,
        stray_w_cm2_sr: wp.array2d[float],  # (n_view, n_band); where on
        # out
        sky_w_cm2: wp.array3d[float],  # (n_view, n_band, n_node) in a pixel
        earth_km: wp.array3d[float],  # (n_view, 2, n_node) height, and sunlight on the ground over 1 au's; where on
    ):
        view, node = wp.tid()
        seen = views[view]
        apparent = wp.transpose(seen.axes) * background.direction[node]
        direction = wp.normalize(apparent - seen.velocity_m_s / SPEED_OF_LIGHT_M_S)
        sun = sun_direction(background.sun, time_s[view])
        sunward = turned_back(background.sun, sun, direction)
        if wp.static(earth):
            geometry = earth_geometry(background.earth, seen.position_m, apparent, sun)
            earth_km[view, 0, node] = float(geometry[0])
            earth_km[view, 1, node] = float(geometry[1]) * sun_strength(background.sun, time_s[view])
        for band in range(sky_w_cm2.shape[1]):
            radiance = sky_radiance(background.plates, band, direction, sunward)
            if wp.static(stray):
                radiance += stray_w_cm2_sr[view, band]
            sky_w_cm2[view, band, node] = radiance * background.pixel_sr[node]

    return background_nodes_kernel


@wp.struct
class Cell:
    """Values at the corners of a cell of nodes, as they are along a row of pixels."""

    start: float
    slope: float  # per pixel


@wp.func
def along_row(values: wp.array[float], background: Background, node: int, v: float) -> Cell:
    """Values between the four nodes of a cell, from its left edge on, `v` of the way down."""
    left = wp.lerp(values[node], values[node + background.n_across], v)
    right = wp.lerp(values[node + 1], values[node + 1 + background.n_across], v)
    cell = Cell()
    cell.start = left
    cell.slope = (right - left) / float(background.step_px)
    return cell


@wp.func
def earth_cell_is_dark(heights: wp.array[float], background: Background, node: int) -> bool:
    """Whether all lines of sight of a cell pass above what glows."""
    n = background.n_across
    least = wp.min(wp.min(heights[node], heights[node + 1]), wp.min(heights[node + n], heights[node + n + 1]))
    return least > background.earth.step_km * float(background.earth.n_height)


@wp.func
def earth_cell_is_disc(heights: wp.array[float], background: Background, node: int) -> bool:
    """Whether all pixels of a cell lie on the disc, their heights below the ground by more than they span."""
    n = background.n_across
    most = wp.max(wp.max(heights[node], heights[node + 1]), wp.max(heights[node + n], heights[node + n + 1]))
    least = wp.min(wp.min(heights[node], heights[node + 1]), wp.min(heights[node + n], heights[node + n + 1]))
    return most + 2.0 * (most - least) / float(background.step_px) < -0.02


@wp.func
def add_disc(
    background: Background,
    band: int,
    cosine: Cell,
    sky: Cell,
    node: int,
    v: float,
    first: int,
    n_pixel: int,
    thread: int,
    n_thread: int,
    signal_w_cm2: wp.array[float],
):
    """Replace the sky by the disc in pixels of a row of a cell that all lie on it; of them, those of a thread."""
    area = along_row(background.pixel_sr, background, node, v)
    emitted, reflected = background.earth.disc_w_cm2_sr[band, 0], background.earth.disc_w_cm2_sr[band, 1]
    for pixel in range(thread, n_pixel, n_thread):
        i = float(pixel)
        radiance = emitted + reflected * wp.max(cosine.start + cosine.slope * i, 0.0)
        light = radiance * (area.start + area.slope * i) - (sky.start + sky.slope * i)
        signal_w_cm2[first + pixel] = signal_w_cm2[first + pixel] + light


@wp.func
def earth_at(background: Background, earth_km: wp.array2d[float], band: int, node: int, u: float, v: float) -> wp.vec2:
    """Radiance of the Earth at a position in a cell, u of the way across, v down [W/cm2/sr], and how much it covers."""
    heights, cosines = earth_km[0], earth_km[1]
    n, step = background.n_across, float(background.step_px)
    left, right = wp.lerp(heights[node], heights[node + n], v), wp.lerp(heights[node + 1], heights[node + n + 1], v)
    down = wp.lerp(heights[node + n] - heights[node], heights[node + n + 1] - heights[node + 1], u)
    span_km = wp.vec2(wp.abs(right - left), wp.abs(down)) / step
    upper, lower = wp.lerp(cosines[node], cosines[node + 1], u), wp.lerp(cosines[node + n], cosines[node + n + 1], u)
    height_km = wp.lerp(left, right, u)
    radiance = earth_radiance(background.earth, band, height_km, span_km, wp.lerp(upper, lower, v))
    return wp.vec2(radiance, disc_part(height_km, span_km))


@functools.cache
def make_add_background_kernel(earth: bool, n_thread: int) -> wp.Kernel:
    """Kernel over rows of images: add the background to each pixel, and flag all strips.

    The n_thread threads of a block draw a row together, each its own pixels. Where there is one, on the CPU, runs of
    pixels are tiles, which the compiler turns into vector instructions.
    """

    @wp.func
    def ramp(light: float, i: float, start: float, slope: float):
        return light + (start + slope * i)

    @wp.kernel(module="unique", enable_backward=False)
    def add_background_kernel(
        # in
        background: Background,
        sky_w_cm2: wp.array3d[float],  # (n_view, n_band, n_node)
        earth_km: wp.array3d[float],  # (n_view, 2, n_node)
        n_col: int,
        n_row: int,
        # in and out
        signal_w_cm2: wp.array[float],  # flat images
        touched: wp.array[wp.uint8],  # (n_image * n_flag,)
    ):
        if wp.static(False):
            _a = ramp
        item, thread = wp.tid(), thread_of_block()
        image = item // n_row
        row = item - image * n_row
        n_band = sky_w_cm2.shape[1]
        view = image // n_band
        band = image - view * n_band
        begin = row * n_col
        strip = image * flags_of_image(n_row * n_col)
        for s in range(begin >> STRIP_SHIFT, ((begin + n_col - 1) >> STRIP_SHIFT) + 1):
            touched[strip + s] = wp.uint8(1)
        begin += image * n_row * n_col
        down = row // background.step_px
        v = float(row - down * background.step_px) / float(background.step_px)
        for across in range(background.n_across - 1):
            node = down * background.n_across + across
            first = across * background.step_px
            end = wp.min(first + background.step_px, n_col)
            sky = along_row(sky_w_cm2[view, band], background, node, v)
            n_whole = int(0)
            if wp.static(n_thread == 1):
                n_whole = (end - first) // RUN
            for run in range(n_whole):
                at = begin + first + run * RUN
                light = wp.tile_load(signal_w_cm2, shape=RUN, offset=at, bounds_check=False)
                i = wp.tile_arange(RUN, dtype=float)
                start = sky.start + sky.slope * float(run * RUN)
                brighter = wp.tile_map(ramp, light, i, start, sky.slope)
                wp.tile_store(signal_w_cm2, brighter, offset=at, bounds_check=False)
            for col in range(first + n_whole * RUN + thread, end, wp.static(n_thread)):
                signal_w_cm2[begin + col] = signal_w_cm2[begin + col] + sky.start + sky.slope * float(col - first)
            if wp.static(earth):
                heights = earth_km[view, 0]
                if earth_cell_is_disc(heights, background, node):
                    cosine = along_row(earth_km[view, 1], background, node, v)
                    n_pixel, step = end - first, wp.static(n_thread)
                    add_disc(background, band, cosine, sky, node, v, begin + first, n_pixel, thread, step, signal_w_cm2)
                elif not earth_cell_is_dark(heights, background, node):
                    area = along_row(background.pixel_sr, background, node, v)
                    for col in range(first + thread, end, wp.static(n_thread)):
                        u = float(col - first) / float(background.step_px)
                        seen = earth_at(background, earth_km[view], band, node, u, v)
                        hidden = seen[1] * (sky.start + sky.slope * float(col - first))
                        pixel = begin + col
                        pixel_sr = area.start + area.slope * float(col - first)
                        signal_w_cm2[pixel] = signal_w_cm2[pixel] + seen[0] * pixel_sr - hidden

    return add_background_kernel


@wp.kernel(module="unique", enable_backward=False)
def add_image_kernel(
    # in
    image_w_cm2: wp.array[float],  # (n_band * n_pixel,)
    n_pixel: int,
    n_band: int,
    # in and out
    signal_w_cm2: wp.array[float],  # flat images, those of a view behind one another
):
    """Add the user's light of every pixel; strips are flagged already."""
    item = wp.tid()
    per_view = n_pixel * n_band
    signal_w_cm2[item] = signal_w_cm2[item] + image_w_cm2[item % per_view]


@wp.kernel(module="unique", enable_backward=False)
def image_of_targets_kernel(
    # in
    xy_px: wp.array2d[wp.vec2d],  # (n_view, n_slot) targets first
    image_w_cm2: wp.array3d[float],  # (n_band, n_row, n_col)
    # in and out
    background_w_cm2: wp.array3d[float],  # (n_view, n_band, n_target)
):
    """Add the user's light of a target's pixel, for the truth; none outside the image."""
    view, target = wp.tid()
    col = int(wp.floor(xy_px[view, target][0] + wp.float64(0.5)))
    row = int(wp.floor(xy_px[view, target][1] + wp.float64(0.5)))
    if col >= 0 and row >= 0 and row < image_w_cm2.shape[1] and col < image_w_cm2.shape[2]:
        for band in range(image_w_cm2.shape[0]):
            background_w_cm2[view, band, target] = background_w_cm2[view, band, target] + image_w_cm2[band, row, col]


@functools.cache
def make_background_of_targets_kernel(earth: bool) -> wp.Kernel:
    """Kernel over views and targets: the background in the pixel that holds a target, for the truth."""

    @wp.kernel(module="unique", enable_backward=False)
    def background_of_targets_kernel(
        # in
        xy_px: wp.array2d[wp.vec2d],  # (n_view, n_slot) targets first
        background: Background,
        sky_w_cm2: wp.array3d[float],  # (n_view, n_band, n_node)
        earth_km: wp.array3d[float],  # (n_view, 2, n_node)
        # out
        background_w_cm2: wp.array3d[float],  # (n_view, n_band, n_target) NaN outside the grid
    ):
        view, target = wp.tid()
        step = wp.float64(background.step_px)
        pixel = xy_px[view, target] + wp.vec2d(wp.float64(0.5), wp.float64(0.5))
        x, y = wp.floor(pixel[0]) / step, wp.floor(pixel[1]) / step
        n_band = sky_w_cm2.shape[1]
        if (
            x < wp.float64(-1.0)
            or y < wp.float64(-1.0)
            or x > wp.float64(background.n_across)
            or y > wp.float64(background.n_down)
        ):
            for band in range(n_band):
                background_w_cm2[view, band, target] = wp.nan
            return
        across = wp.clamp(int(wp.floor(x)), 0, background.n_across - 2)
        down = wp.clamp(int(wp.floor(y)), 0, background.n_down - 2)
        u, v = float(x - wp.float64(across)), float(y - wp.float64(down))
        node = down * background.n_across + across
        for band in range(n_band):
            sky = along_row(sky_w_cm2[view, band], background, node, v)
            level = sky.start + sky.slope * u * float(background.step_px)
            if wp.static(earth):
                seen = earth_at(background, earth_km[view], band, node, u, v)
                area = along_row(background.pixel_sr, background, node, v)
                pixel_sr = area.start + area.slope * u * float(background.step_px)
                level = level * (1.0 - seen[1]) + seen[0] * pixel_sr
            background_w_cm2[view, band, target] = level

    return background_of_targets_kernel
