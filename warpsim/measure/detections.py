"""Detections: what is reported of images, from their pixels or drawn from truth, as directions with their errors."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from warpsim.arguments import above_zero, chosen_names, whole_number
from warpsim.arrays import F64
from warpsim.errors import InputError
from warpsim.instant import utc_dates
from warpsim.measure.detection_rows import ROW, Draws, Rows, Search, draw_detections, find_detections
from warpsim.measure.finding import FINDERS
from warpsim.render.descriptions import STATE_NAMES, STATE_UNITS
from warpsim.render.frameset import FrameSet
from warpsim.render.line_of_sight import ViewGeometry
from warpsim.render.renderer import Renderer
from warpsim.scene.provenance import provenance
from warpsim.scene.scenario import Scenario
from warpsim.scene.scene import Scene

if TYPE_CHECKING:
    from astropy.table import Table

Views = Callable[[int, str], ViewGeometry]
Image = tuple[int, str, str]
"""Frame, sensor and band."""

_STEP_PX = 0.01
"""Step of the camera's derivatives."""

UNITS = {
    "time_s": "s", "x_px": "pix", "y_px": "pix", "x_sigma_px": "pix", "y_sigma_px": "pix", "ra_deg": "deg",
    "dec_deg": "deg", "ra_cosdec_sigma_deg": "deg", "dec_sigma_deg": "deg", "irradiance_w_cm2": "W / cm2",
    "irradiance_sigma_w_cm2": "W / cm2",
} | {name: unit for name, unit in STATE_UNITS.items() if name.startswith("sensor_")}  # fmt: skip


def detections(
    source: Scene | Scenario | Renderer | FrameSet,
    frames: Iterable[int] | None = None,
    sensors: str | Sequence[str] | None = None,
    bands: str | Sequence[str] | None = None,
    *,
    method: str | None = None,
    threshold_sigma: float = 5.0,
    probability: float | None = None,
    clutter_per_image: float = 0.0,
    seed: int = 0,
    background_px: int = 32,
    match_px: float = 1.5,
) -> Table:
    """Return what is detected in images, one row per detection, in time order.

    With the method "truth" detections are drawn from truth, and no pixel is rendered: errors of positions and light are
    Gaussian with the Cramer-Rao bounds of the truth (of positions at most that of a pixel, 12^-1/2 px); a target is
    detected where its light, as drawn, is above the threshold; targets of one clump are one detection at the centroid
    of their light. Stars are left out. The numbers of an image do not depend on what else is asked for. The other
    methods find sources in the pixels, in passes from bright to faint, and fit all of an image by its point spread
    function: stars are detected too, and movement during the exposure is no part of the fit.

    Columns: frame, time_s (after the epoch, in the middle of the exposure of its row), date_obs (UTC), sensor, band,
    x_px, y_px, x_sigma_px, y_sigma_px; ra_deg and dec_deg, the geometric direction from the sensor in GCRS axes, as of
    `FrameSet.line_of_sight`; ra_cosdec_sigma_deg, dec_sigma_deg and ra_dec_corr, their errors, of positions alone;
    irradiance_w_cm2, irradiance_sigma_w_cm2, snr, their ratio; sensor_x_m ... sensor_vz_m_s, the sensor's geocentric
    state, and sensor_qx ... sensor_qw, the rotation from GCRS to camera axes; target, "" for none; clump_id, -1 for
    none; n_merged, how many targets are in the clump; poor_fit, that one source does not explain the pixels, or that
    two would as well: errors of its position are then those of a pixel.

    Args:
        source: What is observed; of rendered frames, those.
        frames: Frame numbers; all when left out.
        sensors: As in `Renderer.render`.
        bands: As in `Renderer.render`.
        method: "truth"; of rendered frames also "matched_filter", the default, and "sep" or "photutils" (extra
            `detect`), which find what is then fitted alike.
        threshold_sigma: Least light of a detection over its error.
        probability: Of "truth": that a target is detected, however bright.
        clutter_per_image: Of "truth": mean number of false detections, even over the image, just above the threshold;
            none where the background fills the pixels of all its targets.
        seed: Of "truth": another one draws other numbers.
        background_px: Side of the boxes whose medians are the background of an image; 0 for none.
        match_px: How far from a target's position a detection in an image may be to have its name.

    Raises:
        InputError: An unknown name or method, a number out of range, or the extra is not there.
    """
    chosen = _checked_method(method, isinstance(source, FrameSet))
    threshold = above_zero("threshold_sigma", threshold_sigma)
    box_px = whole_number("background_px", background_px, 0)
    search = Search(chosen, threshold, box_px, above_zero("match_px", match_px))
    draws = Draws(threshold, *_checked_draws(probability, clutter_per_image), whole_number("seed", seed, 0))
    if chosen != "truth" and draws != Draws(threshold):
        raise InputError("must be left out where detections are found in pixels", "probability, clutter, seed")
    scenario, truth, views, images = _observed(source, frames, sensors, bands)
    if chosen == "truth":
        instrument = scenario.instrument_of(images[0][1]) if images else next(iter(scenario.instruments.values()))
        found = draw_detections(truth, len(scenario.target_names), instrument, draws)
    else:
        assert isinstance(source, FrameSet)  # by the check of the method
        found = find_detections(source, images, truth, search)
    table = _table(scenario, views, images, np.concatenate([np.zeros(0, ROW), *found]))
    settings: Draws | Search = draws if chosen == "truth" else search
    table.meta |= {name.upper(): value for name, value in asdict(settings).items() if value is not None}
    table.meta["METHOD"] = chosen
    return table


def _checked_method(method: str | None, rendered: bool) -> str:
    """The method, for rendered frames or a scene."""
    chosen = ("matched_filter" if rendered else "truth") if method is None else method
    methods = ["truth", *FINDERS] if rendered else ["truth"]
    if chosen not in methods:
        more = "" if rendered else " of a scene; others need rendered frames"
        raise InputError(f"must be {'one of ' if rendered else ''}{', '.join(methods)}{more}", "method", method)
    return chosen


def _checked_draws(probability: Any, clutter_per_image: Any) -> tuple[float | None, float]:
    """Numbers that detections are drawn with."""
    for name, value, most in (("probability", probability, 1.0), ("clutter_per_image", clutter_per_image, 1e6)):
        is_number = isinstance(value, int | float | np.number) and not isinstance(value, bool)
        if not (name == "probability" and value is None) and not (is_number and 0.0 <= value <= most):
            raise InputError(f"must be a number from 0 to {most:g}", name, value)
    return None if probability is None else float(probability), float(clutter_per_image)


def _observed(
    source: Any, frames: Iterable[int] | None, sensors: Any, bands: Any
) -> tuple[Scenario, Table, Views, list[Image]]:
    """The scenario, truth by frame, sensor, band and target, geometry of views, and the images by their labels."""
    from scipy.spatial.transform import Rotation

    if isinstance(source, FrameSet):
        truth = _chosen(source, frames, sensors, bands)
    else:
        source = source if isinstance(source, Renderer) else Renderer(source)
        truth = source.truth(frames, sensors, bands)
    scenario: Scenario = source.scenario
    firsts = truth[:: len(scenario.target_names)] if len(truth) else truth
    images = [(int(frame), str(sensor), str(band)) for frame, sensor, band in firsts["frame", "sensor", "band"]]
    attitude = Rotation.from_quat(np.stack([firsts[f"sensor_q{axis}"] for axis in "xyzw"], axis=1))
    axes = dict(zip([image[:2] for image in images], attitude.as_matrix(), strict=True))

    def view(frame: int, sensor: str) -> ViewGeometry:
        instrument = scenario.instrument_of(sensor)
        time_s = float(instrument.frame_time_s([frame])[0])
        return ViewGeometry(scenario, instrument, sensor, time_s, axes[frame, sensor])

    return scenario, truth, view, images


def _chosen(frames: FrameSet, numbers: Any, sensors: Any, bands: Any) -> Table:
    """The truth of some of the rendered frames."""
    chosen_frames = frames.frames if numbers is None else [whole_number("frames", number, 0) for number in numbers]
    for number in chosen_frames:
        frames.image_numbers("frames", number, frames.sensors[0], frames.bands[0])
    names = chosen_names("sensors", sensors, frames.sensors), chosen_names("bands", bands, frames.bands)
    axes: Any = ((frames.frames, chosen_frames), (frames.sensors, names[0]), (frames.bands, names[1]))
    chosen = [[known.index(one) for one in some] for known, some in axes]
    shape = [len(known) for known, _ in axes]
    return frames.truth[np.arange(len(frames.truth)).reshape(*shape, -1)[np.ix_(*chosen)].ravel()]


def _table(scenario: Scenario, views: Views, images: list[Image], rows: Rows) -> Table:
    """Detections of images as a table, in time order."""
    from astropy.table import Table

    labels = [images[number] for number in rows["image"].tolist()]
    names = [*scenario.target_names, ""]
    sky, light, sigma = _sky(views, images, rows), rows["irradiance_w_cm2"], rows["sigma"]
    columns: dict[str, Any] = {
        "frame": np.array([frame for frame, _, _ in labels], dtype=np.int64),
        "time_s": sky["time_s"],
        "date_obs": np.asarray(utc_dates(scenario.scene.epoch_utc, sky["time_s"]), dtype="U26"),
        "sensor": np.array([sensor for _, sensor, _ in labels], dtype=str),
        "band": np.array([band for _, _, band in labels], dtype=str),
        "x_px": rows["xy_px"][:, 0], "y_px": rows["xy_px"][:, 1], "x_sigma_px": sigma[:, 0], "y_sigma_px": sigma[:, 1],
        **{name: sky[name] for name in ("ra_deg", "dec_deg", "ra_cosdec_sigma_deg", "dec_sigma_deg", "ra_dec_corr")},
        "irradiance_w_cm2": light, "irradiance_sigma_w_cm2": sigma[:, 2], "snr": light / sigma[:, 2],
        **{name: values for name, values in sky.items() if name.startswith("sensor_")},
        "target": np.array([names[number] for number in rows["target"].tolist()], dtype=str),
        **{name: rows[name] for name in ("clump_id", "n_merged", "poor_fit")},
    }  # fmt: skip
    table = Table(columns, meta=provenance(scenario.scene))
    for name, unit in UNITS.items():
        table[name].unit = unit
    return table[np.lexsort((np.arange(len(table)), table["frame"], table["time_s"]))]


def _sky(views: Views, images: list[Image], rows: Rows) -> dict[str, F64]:
    """Times, directions with their errors, and states of sensors, of all detections."""
    step = _STEP_PX * np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1]])
    parts = [np.zeros((0, 26))]
    for own in np.split(rows, np.flatnonzero(np.diff(rows["image"], append=-1)) + 1)[:-1]:  # image by image
        frame, sensor, _ = images[own["image"][0]]
        view, points = views(frame, sensor), own["xy_px"]
        line = view.line_of_sight((points[:, None] + step).reshape(-1, 2), None, "gcrs")
        time_s, state = view.sensor_states(points[:, 1])
        parts.append(np.column_stack([time_s, state, line.direction.reshape(-1, 15)]))
    values = np.concatenate(parts)
    around: npt.NDArray[np.float64] = values[:, 11:].reshape(-1, 5, 3)
    ra, dec = np.arctan2(around[:, 0, 1], around[:, 0, 0]), np.arcsin(np.clip(around[:, 0, 2], -1.0, 1.0))
    east = np.stack([-np.sin(ra), np.cos(ra), np.zeros_like(ra)], axis=1)
    north = np.stack([-np.sin(dec) * np.cos(ra), -np.sin(dec) * np.sin(ra), np.cos(dec)], axis=1)
    slopes = np.stack([around[:, 1] - around[:, 2], around[:, 3] - around[:, 4]], axis=2) / (2 * _STEP_PX)
    jacobian = np.einsum("nai,nij->naj", np.stack([east, north], axis=1), slopes)  # rad/px
    covariance = np.einsum("nai,ni,nbi->nab", jacobian, rows["sigma"][:, :2] ** 2, jacobian)
    spread = np.sqrt(np.einsum("naa->na", covariance))
    return {
        "time_s": values[:, 0],
        "ra_deg": np.degrees(ra) % 360.0,
        "dec_deg": np.degrees(dec),
        "ra_cosdec_sigma_deg": np.degrees(spread[:, 0]),
        "dec_sigma_deg": np.degrees(spread[:, 1]),
        "ra_dec_corr": covariance[:, 0, 1] / np.where(spread.all(axis=1), spread.prod(axis=1), 1.0),
        **{f"sensor_{name}": values[:, 1 + index] for index, name in enumerate(STATE_NAMES)},
    }
