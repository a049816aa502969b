"""Stage observe_targets: where each target is seen, and how bright."""

import functools

import warp as wp

from warpsim_kernels.apparent import Releases, path_from_target
from warpsim_kernels.attitude_table import AttitudeTables, body_axis, table_quaternion
from warpsim_kernels.camera import Camera, depth, projected_px, within_frame
from warpsim_kernels.earth import Earth, is_occulted
from warpsim_kernels.motion import Attitude, NodeGrid, linear_vector, symmetry_axis
from warpsim_kernels.shapes import Body, projected_area_m2
from warpsim_kernels.temperature import TemperatureTables, temperature_k

IN_FOV = wp.constant(1)
OCCULTED = wp.constant(2)
BEHIND = wp.constant(4)
STOWED = wp.constant(8)
_DARK = wp.constant(10)  # OCCULTED | STOWED
"""Bits of the flag word of an observation."""

_W_CM2_PER_W_M2 = wp.constant(wp.float64(1.0e-4))


@wp.struct
class Target:
    """What a target is, apart from where it is."""

    body: Body
    attitude: Attitude
    table_first: int  # row of the attitude tables where this target's begins
    table_count: int  # its rows; 0: `attitude` says how it turns
    temperature_first: int  # row of the temperature tables where this target's begins
    temperature_count: int  # its rows, at least 1


@wp.struct
class RadianceTable:
    """Where ln(T) nodes of the radiance table lie."""

    ln_temperature_start: wp.float64
    ln_temperature_step: wp.float64
    n_node: int


@wp.func
def band_radiance_w_m2_sr(
    ln_radiance: wp.array2d[wp.float64],  # (n_band, n_node)
    slope: wp.array2d[wp.float64],  # (n_band, n_node) d ln(radiance) / d ln(T) times the node step
    band: int,
    temperature: wp.float64,
    table: RadianceTable,
) -> wp.float64:
    """In-band radiance of a blackbody from a cubic Hermite table of ln(radiance) against ln(T)."""
    x = (wp.log(temperature) - table.ln_temperature_start) / table.ln_temperature_step
    node = wp.clamp(int(wp.floor(x)), 0, table.n_node - 2)
    u = x - wp.float64(node)
    w = wp.float64(1.0) - u
    a = ln_radiance[band, node]
    b = ln_radiance[band, node + 1]
    bend = slope[band, node] * (u * w * w) - slope[band, node + 1] * (u * u * w)
    return wp.exp(a + (b - a) * (u * u * (wp.float64(3.0) - wp.float64(2.0) * u)) + bend)


@functools.cache
def make_observe_targets_kernel(with_tables: bool) -> wp.Kernel:
    """Kernel of the stage; without a target that turns by a table, tables are not in its code."""

    @wp.kernel(module="unique", enable_backward=False)
    def observe_targets_kernel(
        # in
        view_time_s: wp.array[wp.float64],  # (n_view,)
        view_axes: wp.array[wp.mat33d],  # (n_view,)
        view_position_m: wp.array[wp.vec3d],  # (n_view,)
        view_velocity_m_s: wp.array[wp.vec3d],  # (n_view,) barycentric
        position_m: wp.array2d[wp.vec3d],  # (n_body, n_node)
        velocity_m_s: wp.array2d[wp.vec3d],  # (n_body, n_node)
        earth_velocity_m_s: wp.array[wp.vec3d],  # (n_node,)
        releases: Releases,
        grid: NodeGrid,
        first_target: int,  # row of the first target in the tracks
        targets: wp.array[Target],  # (n_target,)
        attitude_tables: AttitudeTables,
        temperature_tables: TemperatureTables,
        camera: Camera,
        earth: Earth,
        # out
        source_xy_px: wp.array2d[wp.vec2d],  # (n_view, n_slot) first slots; far outside the frame if behind the camera
        range_m: wp.array2d[wp.float64],  # (n_view, n_target)
        aspect_rad: wp.array2d[wp.float64],  # (n_view, n_target)
        area_m2: wp.array2d[wp.float64],  # (n_view, n_target)
        temperature: wp.array2d[wp.float64],  # (n_view, n_target) [K]
        flags: wp.array2d[wp.int32],  # (n_view, n_target) IN_FOV | OCCULTED | BEHIND | STOWED
    ):
        """Geometry of every (view, target)."""
        view, target_id = wp.tid()
        time_s = view_time_s[view]
        observer = view_position_m[view]
        earth_velocity = linear_vector(earth_velocity_m_s, time_s, grid)
        path = path_from_target(
            position_m, velocity_m_s, releases, first_target + target_id, time_s, grid, observer, earth_velocity,
            view_velocity_m_s[view],
        )
        flag = int(0)
        place_px = wp.vec2d(wp.float64(-1.0e9), wp.float64(-1.0e9))
        axes = view_axes[view]
        if depth(axes, path.apparent) > wp.float64(0.0):
            place_px = projected_px(camera, axes, path.apparent)
            if within_frame(camera, place_px, wp.float64(0.0)):
                flag = IN_FOV
        else:
            flag = BEHIND
        if is_occulted(observer, path.vector_m, earth):
            flag = flag | OCCULTED
        if path.stowed != 0:
            flag = flag | STOWED

        target = targets[target_id]
        axis = symmetry_axis(target.attitude, path.emission_time_s)
        if wp.static(with_tables):
            if target.table_count > 0:
                axis = body_axis(
                    table_quaternion(attitude_tables, target.table_first, target.table_count, path.emission_time_s)
                )
        towards_sensor = path.vector_m / wp.max(path.range_m, wp.float64(1.0e-3)) * wp.float64(-1.0)
        cosine = wp.dot(axis, towards_sensor)
        sine = wp.length(wp.cross(axis, towards_sensor))
        source_xy_px[view, target_id] = place_px
        range_m[view, target_id] = path.range_m
        aspect_rad[view, target_id] = wp.atan2(sine, cosine)
        area_m2[view, target_id] = projected_area_m2(target.body, cosine, sine)
        temperature[view, target_id] = temperature_k(
            temperature_tables, target.temperature_first, target.temperature_count, path.emission_time_s
        )
        flags[view, target_id] = flag

    return observe_targets_kernel


@wp.kernel(enable_backward=False)
def emit_kernel(
    # in
    emissivity: wp.array2d[wp.float64],  # (n_band, n_target)
    ln_radiance: wp.array2d[wp.float64],  # (n_band, n_node)
    ln_radiance_slope: wp.array2d[wp.float64],  # (n_band, n_node)
    table: RadianceTable,
    range_m: wp.array2d[wp.float64],  # (n_view, n_target)
    area_m2: wp.array2d[wp.float64],  # (n_view, n_target)
    temperature: wp.array2d[wp.float64],  # (n_view, n_target) [K]
    flags: wp.array2d[wp.int32],  # (n_view, n_target)
    # out
    source_irradiance_w_cm2: wp.array3d[float],  # (n_view, n_band, n_slot) targets take the first slots
):
    """Graybody emission: emissivity * radiance(T) * projected area / range squared; 0 when occulted or stowed."""
    view, band, target = wp.tid()
    irradiance = float(0.0)
    if (flags[view, target] & _DARK) == 0:
        radiance = band_radiance_w_m2_sr(ln_radiance, ln_radiance_slope, band, temperature[view, target], table)
        intensity_w_sr = emissivity[band, target] * radiance * area_m2[view, target]
        distance_m = wp.max(range_m[view, target], wp.float64(1.0))
        irradiance = float(intensity_w_sr / (distance_m * distance_m) * _W_CM2_PER_W_M2)
    source_irradiance_w_cm2[view, band, target] = irradiance


@wp.kernel(enable_backward=False)
def record_targets_kernel(
    # in
    source_xy_px: wp.array2d[wp.vec2d],  # (n_view, n_slot)
    source_irradiance_w_cm2: wp.array3d[float],  # (n_view, n_band, n_slot)
    # out
    xy_px: wp.array2d[wp.vec2d],  # (n_view, n_target)
    irradiance_w_cm2: wp.array3d[float],  # (n_view, n_band, n_target)
):
    """Keep, for the truth, the very numbers that the deposit draws: label and light cannot differ."""
    view, band, target = wp.tid()
    irradiance_w_cm2[view, band, target] = source_irradiance_w_cm2[view, band, target]
    if band == 0:
        xy_px[view, target] = source_xy_px[view, target]
