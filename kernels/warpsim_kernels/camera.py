"""Camera axes and gnomonic projection, float64."""

import warp as wp


@wp.struct
class Camera:
    """Pinhole camera. Pixel centres lie on integers; x runs along columns, y along rows."""

    n_row: int
    n_col: int
    focal_px: wp.float64
    centre_x_px: wp.float64
    centre_y_px: wp.float64


@wp.func
def projected_px(camera: Camera, axes: wp.mat33d, direction: wp.vec3d) -> wp.vec2d:
    """Pixel coordinates of a direction in front of the camera (rows of axes: x, y, z)."""
    seen = axes * direction
    scale = camera.focal_px / seen[2]
    return wp.vec2d(camera.centre_x_px + seen[0] * scale, camera.centre_y_px + seen[1] * scale)


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
