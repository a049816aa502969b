"""Amount rendered at a time: views of a pass, images of a part of it."""

from __future__ import annotations

import warp as wp
from warpsim_kernels.signature import N_TERM

from warpsim.render.batch import column_bytes
from warpsim.render.device_scene import DeviceScene
from warpsim.render.stages import is_read_out_at_once
from warpsim.sky.star_counts import most_stars_in_cone

BYTES_PER_PASS = 32 * 2**20
"""Size of the signal of all images of a pass on the CPU, so large that the Python of a pass, 50 to 150 us, does
not count; and size of its source lists."""

BYTES_PER_PASS_CUDA = 512 * 2**20
"""Size of the source lists of a pass on CUDA: launches over views should be large. That of the signal, too,
where counts go to the host by way of the pipeline."""

SIGNAL_BYTES_AT_A_TIME = 2**20
"""Signal that one CPU pipeline holds, but an image at least: it is to stay in the cache from deposit to read-out."""

SIGNAL_BYTES_AT_A_TIME_CUDA = 512 * 2**20
"""The same on CUDA. That it is more than the cache holds costs less than launches of few threads: on an H200 an image
of 1024 x 1024 takes 19 us with 32 MiB, 10 with 128 and 6.5 with 512."""

MOST_CERTAIN_STARS = 8192
"""Stars of a view for which lists are made that are certain to hold all: in one band 0.7 MB a view for Gaussians and
1.3 MB for patterns, most of it their spots."""

MOST_FLOATS = 2**31 - 129
"""Largest signal of a pass: longer arrays are beyond Warp."""

PASSES_PER_PIPELINE = 4
"""Pieces that a short call is cut into for each of several pipelines, so that none waits long for another."""

PIXELS_PER_PASS = 2**19
"""A pass of fewer pixels is not cut further: it is about a millisecond of work, and 50 to 150 us of Python."""

PIXELS_PER_PASS_CUDA = 2**25
"""The same on CUDA."""


def n_pixel_of(scene: DeviceScene) -> int:
    """Return the pixels of a view's images."""
    camera = scene.instrument.sensor.camera
    return int(scene.n_band * camera.n_row * camera.n_col)


def images_at_a_time(scene: DeviceScene, n_view: int) -> int:
    """Return the views of a pass whose images are drawn and read out together."""
    n_pixel = n_pixel_of(scene)
    n_byte = SIGNAL_BYTES_AT_A_TIME_CUDA if scene.device.is_cuda else SIGNAL_BYTES_AT_A_TIME
    return max(1, min(n_view, n_byte // (4 * n_pixel), MOST_FLOATS // n_pixel))


def certain_slots(scene: DeviceScene) -> int | None:
    """Return a length of source lists that no view can exceed, by the stars in any cone that `gather_stars` searches.

    None where these are more than MOST_CERTAIN_STARS, or views differ in radius, as light moves during the exposure.
    """
    if scene.streaks.enabled:
        return None
    stars = scene.stars
    n_star = most_stars_in_cone(stars.index.direction_icrs, stars.field.radius_rad)
    return scene.n_target + max(n_star, 1) if n_star <= MOST_CERTAIN_STARS else None


def most_views(scene: DeviceScene, n_slot: int, chunk_bytes: int | None = None, to_host: bool = False) -> int:
    """Return the views whose source lists and columns fit the memory of a pass, and whose signal would; at least one.

    On CUDA views may be more than the images that are held, unless their counts go by way of the pipeline.
    """
    room = chunk_bytes or (BYTES_PER_PASS_CUDA if scene.device.is_cuda else BYTES_PER_PASS)
    slot_bytes = 16 + 4 * scene.n_band + 4  # position, irradiance, star
    if is_read_out_at_once(scene):
        slot_bytes += scene.n_band * wp.types.type_size_in_bytes(scene.psf.spots.Spot)
    if scene.streaks.enabled:
        slot_bytes += 24 + 8 * scene.streaks.n_path * (1 + scene.streaks.rolls)  # direction, movement
    series_bytes = 8 * N_TERM * scene.field.n_profile * scene.n_target
    view_bytes = slot_bytes * n_slot + series_bytes + column_bytes(scene)
    n_pixel = n_pixel_of(scene)
    n_image = MOST_FLOATS // n_pixel
    if chunk_bytes or to_host or not scene.device.is_cuda:
        n_image = min(n_image, room // (4 * n_pixel))
    return max(1, int(min(n_image, room // view_bytes)))


def views_of_a_pass(scene: DeviceScene, n_view: int, most: int, n_pipeline: int) -> int:
    """Return as many views as memory allows, but so few that every pipeline has something to do until the end."""
    if n_pipeline == 1:
        return min(n_view, most)
    least = (PIXELS_PER_PASS_CUDA if scene.device.is_cuda else PIXELS_PER_PASS) // n_pixel_of(scene)
    fair = max(-(-n_view // (PASSES_PER_PIPELINE * n_pipeline)), least)
    return max(1, min(most, fair, -(-n_view // n_pipeline)))
