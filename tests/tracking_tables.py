"""Detections made of truth: positions with noise, seen through `line_of_sight`."""

import numpy as np
from astropy.table import Table

C_M_S = 299792458.0
AXES = ("x", "y", "z")


def made_detections(frames, truth, sigma_px, rng):
    """Detections of all rows of the truth, each moved by noise in both axes of its image."""
    rows = []
    for row in truth:
        xy = np.array([row["x_px"], row["y_px"]]) + rng.normal(0.0, sigma_px, 2)
        points = xy + np.array([[0.0, 0.0], [0.5, 0.0], [-0.5, 0.0], [0.0, 0.5], [0.0, -0.5]])
        x, y, z = frames.line_of_sight(row["frame"], row["sensor"], points).direction.T
        ra, dec = np.degrees(np.arctan2(y, x)) % 360.0, np.degrees(np.arcsin(z))
        steps = [((part[1] - part[2]), (part[3] - part[4])) for part in (ra * np.cos(np.radians(dec[0])), dec)]
        covariance = sigma_px**2 * np.array(steps) @ np.array(steps).T
        sigma = np.sqrt(np.diag(covariance))
        rows.append(
            {name: row[name] for name in ("frame", "time_s", "date_obs", "sensor", "band", "target", "snr")}
            | {"x_px": xy[0], "y_px": xy[1], "x_sigma_px": sigma_px, "y_sigma_px": sigma_px}
            | {"ra_deg": ra[0], "dec_deg": dec[0], "ra_cosdec_sigma_deg": sigma[0], "dec_sigma_deg": sigma[1]}
            | {"ra_dec_corr": covariance[0, 1] / sigma.prod() if sigma_px else 0.0}
            | {f"sensor_{axis}_m": row[f"sensor_{axis}_m"] for axis in AXES}
        )
    return Table(rows=rows)
