"""Truth with states, and detections made of it: positions with noise, seen through `line_of_sight`."""

import numpy as np
from astropy.table import Table
from astropy.time import Time, TimeDelta

C_M_S = 299792458.0
AXES = ("x", "y", "z")


def with_states(frames):
    """The truth, with dates, and states of sensors and targets."""
    truth, scenario = frames.truth.copy(), frames.scenario
    if "target_x_m" in truth.colnames:
        return truth
    epoch = Time(frames.scene.epoch_utc, scale="utc")
    times = (epoch.tai + TimeDelta(np.asarray(truth["time_s"]), format="sec")).utc
    times.precision = 6
    truth["date_obs"] = times.isot
    emission_s = truth["time_s"] - 1e3 * truth["range_km"] / C_M_S

    def states(names, time_s, h_s=0.05):
        position = np.empty((len(truth), 3, 3))
        for name in np.unique(names):
            rows = np.flatnonzero(names == name)
            for step, shift in enumerate((-h_s, 0.0, h_s)):
                position[rows, step] = scenario.position_m(str(name), time_s[rows] + shift)
        return position[:, 1], (position[:, 2] - position[:, 0]) / (2 * h_s)

    for prefix, name, time_s in (("sensor", "sensor", truth["time_s"]), ("target", "target", emission_s)):
        position, velocity = states(np.asarray(truth[name]), np.asarray(time_s))
        for number, axis in enumerate(AXES):
            truth[f"{prefix}_{axis}_m"], truth[f"{prefix}_v{axis}_m_s"] = position[:, number], velocity[:, number]
    return truth


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
            | {"ra_dec_corr": covariance[0, 1] / sigma.prod()}
            | {f"sensor_{axis}_m": row[f"sensor_{axis}_m"] for axis in AXES}
        )
    return Table(rows=rows)
