"""What the columns of tables mean, and their units: of truth, stars, labels, detections and scores."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from astropy.table import Table

STATE_NAMES = ("x_m", "y_m", "z_m", "vx_m_s", "vy_m_s", "vz_m_s", "qx", "qy", "qz", "qw")
"""Of position, velocity and attitude, behind `sensor_` or `target_`."""

STATE_UNITS = {
    f"{body}_{name}": "m" if name in STATE_NAMES[:3] else "m / s"
    for body in ("sensor", "target")
    for name in STATE_NAMES[:6]
}

DESCRIPTIONS = {
    "frame": "frame number",
    "time_s": "time of the frame after the epoch",
    "date_obs": "UTC of the frame, middle of the exposure",
    "sensor": "name of the sensor",
    "band": "name of the band",
    "target": "name of the target",
    "class": "class of the target: as its entry in the scene says, or the entry's name",
    "access": "the sensor may observe the target: all of its access rules hold",
    "in_fov": "the position in the middle of the exposure lies on the array",
    "occulted": "the Earth lies between sensor and target",
    "not_deployed": "still with the main target of its group, without light of its own",
    "absent": "before or after it exists; nothing else is known of it",
    "x_px": "column of the middle of the exposure; pixel centres on whole numbers from 0",
    "y_px": "row of the middle of the exposure; pixel centres on whole numbers from 0",
    "dx_px": "columns from the start of the exposure to its end",
    "dy_px": "rows from the start of the exposure to its end",
    "row_time_s": "mid-exposure of the target's row after the frame's time",
    "range_km": "distance from the sensor to where the light left",
    "aspect_deg": "angle between the body axis and the direction to the sensor",
    "projected_area_m2": "projected area, mean over the exposure",
    "temperature_k": "temperature when the light left",
    "sunlit_fraction": "part of the Sun's disc that the target sees; NaN where sunlight is left out",
    "irradiance_w_cm2": "in-band irradiance at the pupil; 0 when occulted, not deployed or absent",
    "emitted_w_cm2": "part of the irradiance that the target emits",
    "sun_w_cm2": "part of the irradiance that is reflected sunlight",
    "earth_w_cm2": "part of the irradiance that is reflected Earth infrared",
    "albedo_w_cm2": "part of the irradiance that is reflected Earth albedo",
    "snr": "irradiance over NEI: all the light in one pixel",
    "snr_peak": "light in the target's own pixel over NEI",
    "left_out_w_cm2": "light beyond the target's stamp, which the image lacks",
    "background_w_cm2": "what the background adds to the target's pixel; NaN far outside the frame",
    "noise_nei": "standard deviation of the noise of a pixel with the background",
    "earth_behind": "the line of sight meets the Earth behind the target",
    "neighbour_px": "distance to the nearest other target with light in the image; NaN without one",
    "clump_id": "number of its clump in the image: targets that merge share one; -1 without light",
    "resolvable": "gives light, and is alone in its clump",
    "blend_fraction": "part of the light of all targets in its own pixel that others give",
    "x_sigma_px": "Cramer-Rao bound of an unbiased fit of its x, y and light to the image, all else known",
    "y_sigma_px": "Cramer-Rao bound of y",
    "irradiance_sigma_w_cm2": "Cramer-Rao bound of the irradiance",
    **{
        f"{body}_{name}": f"{what}, geocentric, GCRS axes{when}"
        for body, when in (("sensor", ""), ("target", ", when the light left"))
        for name, what in zip(STATE_NAMES[:6], ["position"] * 3 + ["velocity"] * 3, strict=True)
    },
    **{f"sensor_{name}": "quaternion of the rotation from GCRS to camera axes" for name in STATE_NAMES[6:]},
    **{f"target_{name}": "the same to body axes, when the light left" for name in STATE_NAMES[6:]},
    "visible": "gives light, and is on the array at some time of the exposure",
    "keypoint_visibility": "2: its own pixel gets least_nei NEI of its light; 1: visible, but less or off the array",
    "box_x_px": "left edge of the box; pixel edges on whole numbers from 0",
    "box_y_px": "upper edge of the box; pixel edges on whole numbers from 0",
    "box_w_px": "width of the box",
    "box_h_px": "height of the box",
    "mask_rle": "pixels with least_nei NEI of its light or more, COCO's compressed run lengths; empty if none",
    "kind": "hit: charge of a radiation hit; flicker: of a pixel that flickers and is on",
    "charge_e": "charge of a hit or a flickering pixel, of a detector in electrons",
    "ra_deg": "right ascension of the geometric direction from the sensor, GCRS axes",
    "dec_deg": "declination of the geometric direction from the sensor, GCRS axes",
    "ra_cosdec_sigma_deg": "its error along right ascension",
    "dec_sigma_deg": "its error along declination",
    "ra_dec_corr": "correlation of both errors",
    "n_merged": "targets in the clump; 0 for none",
    "poor_fit": "one source does not explain the pixels, or two would as well: errors are those of a pixel",
    "truth_w_cm2": "irradiance that was drawn",
    "others_w_cm2": "what other targets add to the measured irradiance",
    "full_px": "full pixels that were left out",
    "blended": "other targets add more than 0.3 of the error",
    "catalog_row": "row of the star in the catalog",
    "id": "name of the star in the catalog",
}
"""By name of the column."""


UNITS = {
    "time_s": "s", "row_time_s": "s", "x_px": "pix", "y_px": "pix", "dx_px": "pix", "dy_px": "pix", "range_km": "km",
    "aspect_deg": "deg", "projected_area_m2": "m2", "temperature_k": "K", "neighbour_px": "pix", "x_sigma_px": "pix",
    "y_sigma_px": "pix", "charge_e": "electron", **STATE_UNITS,
}  # fmt: skip
"""Of columns of truth, stars, artifacts and light curves, besides irradiances."""


def with_units(table: Table) -> Table:
    """Return a table after columns got their units, irradiances too."""
    for column in table.itercols():
        column.unit = UNITS.get(column.name, "W / cm2" if column.name.endswith("_w_cm2") else None)
    return table


def described(table: Table) -> Table:
    """Return a table of plain columns after each of them got its description."""
    for column in table.itercols():
        column.description = DESCRIPTIONS.get(column.name)
    return table
