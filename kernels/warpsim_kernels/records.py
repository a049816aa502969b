"""Records that stages write and truth reads: of a view, and of each target in it."""

import warp as wp


@wp.struct
class View:
    """A camera at an instant; ICRS axes."""

    axes: wp.mat33d  # rows x, y, z
    position_m: wp.vec3d  # geocentric
    velocity_m_s: wp.vec3d  # barycentric
    reach: wp.vec2d  # how far stars move at most during the exposure [px], [rad]; read where they do
    flags: int  # UP_REPLACED | BORESIGHT_REPLACED | SLEWING
    n_required: int  # source slots needed, more than there are where the list is too short


IN_FOV = wp.constant(1)
OCCULTED = wp.constant(2)
BEHIND = wp.constant(4)
NOT_DEPLOYED = wp.constant(8)
ABSENT = wp.constant(16)
DARK = wp.constant(26)
"""Bits of the flag word of an observation; DARK is OCCULTED | NOT_DEPLOYED | ABSENT. An absent target has no other."""


@wp.struct
class Observation:
    """A target as a view sees it."""

    xy_px: wp.vec2d  # in the middle of the exposure; far outside the frame if behind the camera
    range_m: wp.float64
    aspect_rad: wp.float64
    area_m2: wp.float64  # projected
    sun_area_m2: wp.float64  # as Signature has these
    earth_area_m2: wp.float64
    albedo_area_m2_sr: wp.float64
    sunlit: wp.float64
    temperature_k: wp.float64
    flags: int  # IN_FOV | OCCULTED | BEHIND | NOT_DEPLOYED, or ABSENT


@wp.struct
class Sources:
    """Point sources on the focal plane, stars and targets alike; targets take the first slots."""

    n_source: wp.array[wp.int32]  # (n_view,) filled slots
    xy_px: wp.array2d[wp.vec2d]  # (n_view, n_slot) in the middle of the exposure
    irradiance_w_cm2: wp.array3d[float]  # (n_view, n_band, n_slot) in-band, at the pupil
    star: wp.array2d[wp.int32]  # (n_view, n_slot) in cell order; -1 for a target
    direction: wp.array2d[wp.vec3d]  # (n_view, n_slot) apparent, of stars; empty where nothing moves
    offset_px: wp.array3d[wp.vec2]  # (n_view, n_slot, n_path) movement: Legendre coefficients
