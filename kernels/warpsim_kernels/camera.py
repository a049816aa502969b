"""Camera axes, lens distortion and gnomonic projection, float64."""

import functools

import warp as wp


@wp.struct
class Distortion:
    """Brown and Conrady's polynomial on the tangent plane, and how far it serves."""

    k1: wp.float64
    k2: wp.float64
    k3: wp.float64
    p1: wp.float64
    p2: wp.float64
    limit: wp.float64  # beyond this radius the distortion goes on in proportion along each ray


@wp.struct
class Camera:
    """Pinhole camera with a lens. Pixel centres lie on integers; x runs along columns, y along rows."""

    n_row: int
    n_col: int
    focal_px: wp.float64  # in widths of a pixel
    focal_row_px: wp.float64  # in heights of a pixel
    centre_x_px: wp.float64
    centre_y_px: wp.float64
    distortion: Distortion  # read where it is on


@wp.func
def pinhole_px(camera: Camera, seen: wp.vec3d) -> wp.vec2d:
    """Pixel coordinates of a vector in camera axes, in front of the camera."""
    scale_x = camera.focal_px / seen[2]
    scale_y = camera.focal_row_px / seen[2]
    return wp.vec2d(camera.centre_x_px + seen[0] * scale_x, camera.centre_y_px + seen[1] * scale_y)


@wp.func
def distorted(lens: Distortion, seen: wp.vec3d) -> wp.vec3d:
    """A vector in camera axes, as a pinhole would have to see it; in front of the camera (Brown 1971, as OpenCV)."""
    scale = wp.max(seen[2], wp.sqrt(seen[0] * seen[0] + seen[1] * seen[1]) / lens.limit)
    x = seen[0] / scale
    y = seen[1] / scale
    two = wp.float64(2.0)
    r2 = x * x + y * y
    radial = wp.float64(1.0) + r2 * (lens.k1 + r2 * (lens.k2 + r2 * lens.k3))
    place_x = x * radial + two * lens.p1 * x * y + lens.p2 * (r2 + two * x * x)
    place_y = y * radial + lens.p1 * (r2 + two * y * y) + two * lens.p2 * x * y
    return wp.vec3d(place_x * scale, place_y * scale, seen[2])


@functools.cache
def projection(distortion: bool) -> wp.Function:
    """The function that projects: (camera, axes, direction) to pixels; without the lens' code where it is off."""

    @wp.func
    def projected_px(camera: Camera, axes: wp.mat33d, direction: wp.vec3d) -> wp.vec2d:
        """Pixel coordinates of a direction in front of the camera (rows of axes: x, y, z)."""
        seen = axes * direction
        if wp.static(distortion):
            seen = distorted(camera.distortion, seen)
        return pinhole_px(camera, seen)

    return projected_px


@wp.func
def depth(axes: wp.mat33d, direction: wp.vec3d) -> wp.float64:
    """Component along the boresight; positive in front of the camera."""
    return axes[2, 0] * direction[0] + axes[2, 1] * direction[1] + axes[2, 2] * direction[2]


@wp.func
def within_frame(camera: Camera, xy_px: wp.vec2d, margin_px: wp.float64) -> bool:
    """True when the point lies on the array or at most margin_px outside it."""
    half = wp.float64(0.5)
    return (
        xy_px[0] >= -half - margin_px
        and xy_px[0] < wp.float64(camera.n_col) - half + margin_px
        and xy_px[1] >= -half - margin_px
        and xy_px[1] < wp.float64(camera.n_row) - half + margin_px
    )


@wp.func
def up_is_lost(boresight: wp.vec3d, up: wp.vec3d) -> bool:
    """True where `up` lies along the boresight, to 1e-9 rad: float64 rounding would choose the roll."""
    across = up - boresight * wp.dot(up, boresight)
    return wp.length(across) <= wp.float64(1.0e-9) * wp.length(up)


@wp.func
def camera_axes(boresight: wp.vec3d, up: wp.vec3d, spare_up: wp.vec3d) -> wp.mat33d:
    """Rows x (right), y (down), z (boresight), with y away from `up`; spare_up serves where up lies along z.

    Should that fail too, because it is 0, the ICRS axis farthest from the boresight serves.
    """
    best = up
    if up_is_lost(boresight, best):
        best = spare_up
        if up_is_lost(boresight, best):
            best = wp.vec3d(wp.float64(1.0), wp.float64(0.0), wp.float64(0.0))
            if wp.abs(boresight[0]) > wp.float64(0.7):
                best = wp.vec3d(wp.float64(0.0), wp.float64(0.0), wp.float64(1.0))
    y = -wp.normalize(best - boresight * wp.dot(best, boresight))
    x = wp.cross(y, boresight)
    return wp.matrix_from_rows(x, y, boresight)
