"""Charge that is not light: radiation hits and flickering pixels, added to the signal before it is read out.

A hit is a straight track through the sensitive layer. Particles come from all sides: through a plane their cosine
squared is uniform, the track's projection on the array is thickness times tangent, its length thickness over cosine.
Energy is lost evenly along the track; its sum has Landau's distribution in the form of Moyal (1955, Phil. Mag. 46,
263): minus the logarithm of a squared unit normal deviate, whose mean is Euler's constant plus ln 2. Showers, knock-on
electrons and diffusion are left out.

A flickering pixel is on or off for whole dwells of frames, each drawn by itself, with a phase of its own.
"""

import warp as wp

from warpsim_kernels.canvas import STRIP_SHIFT, flags_of_image
from warpsim_kernels.poisson import poisson
from warpsim_kernels.random_numbers import normal_cosine, normal_radius, philox4x32

STREAM_HITS = wp.constant(wp.uint32(11))
"""Numbers of hits, counter 0, and where hits are, counters from 1 on."""
STREAM_LOSS = wp.constant(wp.uint32(12))
STREAM_FLICKER = wp.constant(wp.uint32(13))

LONGEST_TANGENT = 30.0
"""Of the angle between track and normal; one hit in 900 is flatter and taken to be so steep."""

_LEAST_COSINE_2 = wp.constant(1.0 / (1.0 + LONGEST_TANGENT**2))
_MOYAL_MEAN = wp.constant(1.2703628454614782)
_UNIT_32 = wp.constant(wp.float64(2.3283064365386963e-10))  # 2**-32
_TURN = wp.constant(wp.float64(6.283185307179586 * 2.3283064365386963e-10))


@wp.struct
class Hits:
    """Radiation hits of an image of one kind of detector."""

    mean: float  # hits of the array and the margin about it
    margin_px: wp.vec2d  # tracks that begin so far outside may reach the array
    thickness_px: wp.vec2d  # of the sensitive layer, in widths and in heights of a pixel
    landau_width: float  # scale of the loss's distribution over its mean
    level_w_cm2: wp.array[float]  # (n_band,) irradiance that equals the mean charge of an upright track


@wp.struct
class Flicker:
    """Flickering pixels; planes by sensor and band."""

    first: wp.array[wp.int32]  # (n_plane + 1,) of a plane's pixels in the arrays below
    pixel: wp.array[wp.int32]  # index in the image
    level_w_cm2: wp.array[float]  # irradiance that equals the charge of a pixel that is on
    phase: wp.array[wp.uint32]  # [frames]
    dwell: wp.uint32  # [frames]
    on_at_most: wp.uint32  # random words of pixels that are on
    n_most: int  # pixels of the fullest plane


@wp.struct
class Track:
    """A hit's way through the layer, on the array [px], and its charge."""

    start_px: wp.vec2d
    way_px: wp.vec2d
    level_w_cm2: float


@wp.func
def uniform(word: wp.uint32) -> wp.float64:
    """A number in (0, 1) from 32 random bits."""
    return (wp.float64(word) + wp.float64(0.5)) * _UNIT_32


@wp.func
def number_of_hits(hits: Hits, frame: wp.uint32, band: wp.uint32, key: wp.vec2ui) -> int:
    """Poisson deviate of the hits of an image."""
    words = philox4x32(wp.vec4ui(frame, wp.uint32(0), band, STREAM_HITS), key[0], key[1])
    return int(poisson(hits.mean, normal_cosine(normal_radius(words[0]), words[1]), words[2]))


@wp.func
def track_of(
    hits: Hits,
    number: int,
    n_col: int,
    n_row: int,
    mean_w_cm2: float,
    frame: wp.uint32,
    band: wp.uint32,
    key: wp.vec2ui,
) -> Track:
    """The track of a hit; mean_w_cm2 is the mean charge of an upright one."""
    words = philox4x32(wp.vec4ui(frame, wp.uint32(number + 1), band, STREAM_HITS), key[0], key[1])
    loss = philox4x32(wp.vec4ui(frame, wp.uint32(number + 1), band, STREAM_LOSS), key[0], key[1])
    width = wp.vec2d(wp.float64(n_col), wp.float64(n_row)) + hits.margin_px * wp.float64(2.0)
    corner = -hits.margin_px - wp.vec2d(wp.float64(0.5), wp.float64(0.5))
    turn = wp.float64(words[2]) * _TURN
    cosine_2 = wp.max(uniform(words[3]), wp.float64(_LEAST_COSINE_2))
    tangent = wp.sqrt((wp.float64(1.0) - cosine_2) / cosine_2)
    track = Track()
    track.start_px = corner + wp.cw_mul(width, wp.vec2d(uniform(words[0]), uniform(words[1])))
    track.way_px = wp.cw_mul(hits.thickness_px, wp.vec2d(wp.cos(turn), wp.sin(turn))) * tangent
    deviate = normal_cosine(normal_radius(loss[0]), loss[1])
    moyal = -wp.log(wp.max(deviate * deviate, 1.0e-12))
    spread = wp.max(1.0 + hits.landau_width * (moyal - _MOYAL_MEAN), 0.0)
    track.level_w_cm2 = mean_w_cm2 * spread / float(wp.sqrt(cosine_2))
    return track


@wp.func
def part_to_border(start: wp.float64, way: wp.float64, cell: int) -> wp.float64:
    """Part of the way after which a track leaves a column, or a row; beyond 1 where it does not."""
    far = wp.float64(2.0)
    if way > wp.float64(0.0):
        far = (wp.float64(cell) + wp.float64(0.5) - start) / way
    if way < wp.float64(0.0):
        far = (wp.float64(cell) - wp.float64(0.5) - start) / way
    return far


@wp.func
def add_level(
    signal_w_cm2: wp.array[float], touched: wp.array[wp.uint8], image: int, n_pixel: int, pixel: int, level_w_cm2: float
):
    """Add to a pixel of an image, and flag its strip."""
    signal_w_cm2[image * n_pixel + pixel] += level_w_cm2
    touched[image * flags_of_image(n_pixel) + (pixel >> STRIP_SHIFT)] = wp.uint8(1)


@wp.kernel(enable_backward=False)
def add_hits_kernel(
    # in
    view_frame: wp.array[wp.uint32],  # (n_view,)
    view_sensor: wp.array[wp.uint32],  # (n_view,)
    band_id: wp.array[wp.uint32],  # (n_band,)
    key: wp.array[wp.vec2ui],  # (n_sensor,)
    hits: Hits,
    n_col: int,
    n_row: int,
    # in and out
    signal_w_cm2: wp.array[float],  # (n_image * n_pixel + STRIP_PIXELS,)
    touched: wp.array[wp.uint8],  # (n_image * n_flag,)
):
    """Add the charge of an image's hits, pixel by pixel along each track; a thread an image."""
    image = wp.tid()
    view = image // band_id.shape[0]
    band = image - view * band_id.shape[0]
    frame, own, sensor = view_frame[view], band_id[band], int(view_sensor[view])
    for number in range(number_of_hits(hits, frame, own, key[sensor])):
        track = track_of(hits, number, n_col, n_row, hits.level_w_cm2[band], frame, own, key[sensor])
        col = int(wp.floor(track.start_px[0] + wp.float64(0.5)))
        row = int(wp.floor(track.start_px[1] + wp.float64(0.5)))
        done = wp.float64(0.0)
        while done < wp.float64(1.0):
            to_col = part_to_border(track.start_px[0], track.way_px[0], col)
            to_row = part_to_border(track.start_px[1], track.way_px[1], row)
            end = wp.max(wp.min(wp.min(to_col, to_row), wp.float64(1.0)), done)
            if col >= 0 and col < n_col and row >= 0 and row < n_row:
                level = track.level_w_cm2 * float(end - done)
                add_level(signal_w_cm2, touched, image, n_row * n_col, row * n_col + col, level)
            if to_col <= to_row:
                col += wp.where(track.way_px[0] > wp.float64(0.0), 1, -1)
            else:
                row += wp.where(track.way_px[1] > wp.float64(0.0), 1, -1)
            done = end


@wp.kernel(enable_backward=False)
def add_flicker_kernel(
    # in
    view_frame: wp.array[wp.uint32],  # (n_view,)
    view_sensor: wp.array[wp.uint32],  # (n_view,)
    band_id: wp.array[wp.uint32],  # (n_band,)
    key: wp.array[wp.vec2ui],  # (n_sensor,)
    flicker: Flicker,
    n_pixel: int,
    # in and out
    signal_w_cm2: wp.array[float],  # (n_image * n_pixel + STRIP_PIXELS,)
    touched: wp.array[wp.uint8],  # (n_image * n_flag,)
):
    """Add the charge of the flickering pixels that are on; a thread a pixel of an image."""
    item = wp.tid()
    image = item // flicker.n_most
    view = image // band_id.shape[0]
    band = image - view * band_id.shape[0]
    sensor = int(view_sensor[view])
    plane = sensor * band_id.shape[0] + band
    number = item - image * flicker.n_most
    listed = flicker.first[plane] + number
    if listed >= flicker.first[plane + 1]:
        return
    dwell = (view_frame[view] + flicker.phase[listed]) // flicker.dwell
    counter = wp.vec4ui(dwell, wp.uint32(number + 1), band_id[band], STREAM_FLICKER)
    if philox4x32(counter, key[sensor][0], key[sensor][1])[0] <= flicker.on_at_most:
        add_level(signal_w_cm2, touched, image, n_pixel, flicker.pixel[listed], flicker.level_w_cm2[listed])
