"""Report of a kind of sensor: its bands, noise, light, access and contents of its fields of view."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt

from warpsim.constants import PLANCK_J_S, SPEED_OF_LIGHT_M_S
from warpsim.detector.detectors import ElectronDetector, NeiDetector, detector_terms
from warpsim.detector.hits_and_flicker import hit_area
from warpsim.detector.levels import ElectronLevels, Levels
from warpsim.detector.pixel_maps import read_maps
from warpsim.optics.camera import Camera
from warpsim.optics.psf import PsfAiry, PsfGaussian
from warpsim.optics.wcs import ERROR_PX, sip_polynomials
from warpsim.output.check_background import background_lines
from warpsim.output.check_pointing import pointing_lines
from warpsim.output.check_views import counted_targets, longest_streaks_px
from warpsim.output.wording import counted
from warpsim.radiometry.band import Band
from warpsim.radiometry.by_band import in_band
from warpsim.scene.band_descriptions import BandDescription
from warpsim.scene.description import SceneDescription
from warpsim.scene.instrument import Instrument
from warpsim.scene.scenario import Scenario
from warpsim.scene.target_access import target_margins
from warpsim.sky.catalog import StarCatalog
from warpsim.sky.star_counts import complete_to

LARGEST_SHIFT_PX = 0.1
"""From row to row of a source's image, beyond which a report warns."""
MOST_TARGETS_LOOKED_AT = 50
"""Targets that are asked why a sensor has no access, spread over those that access counts by."""

LEVELS_NEI = (1, 10, 100, 1000)
"""Irradiances above which stars are counted [NEI]."""

MOST_VIEWS_OF_RULES = 200_000
"""Views without access in which rules are looked at."""

SPHERE_DEG2 = 360.0**2 / math.pi
"""Area of the sky [deg2]."""

RULE_NAMES = {
    "earth_km": "behind the Earth",
    "range_km": "too far",
    "elevation_deg": "too low",
    "grazing_altitude_km": "grazing too low",
    "solar_exclusion_deg": "near the Sun",
    "min_range_km": "too near",
    "max_elevation_deg": "too high",
    "background_altitude_km": "against the Earth or too low over it",
    "target_sunlit": "in the Earth's shadow",
    "fov_deg": "outside the field of view",
}


def sensor_lines(instrument: Instrument, scenario: Scenario, catalog: StarCatalog) -> list[str]:
    """Return the lines of a report about one kind of sensor, under the stars of its sky."""
    times = instrument.frame_time_s(np.arange(instrument.frames.count))
    frames_of = {
        name: np.flatnonzero(instrument.has_access(sensor, times)).astype(np.int32).data  # 4 bytes a frame
        for sensor, name in enumerate(instrument.names)
    }
    views: Mapping[str, Sequence[int]] = {name: frames for name, frames in frames_of.items() if len(frames)}
    views = views or dict.fromkeys(instrument.names, range(instrument.frames.count))
    return [
        *_camera_lines(instrument, scenario),
        *_band_lines(instrument, catalog, scenario.scene),
        *_optics_lines(instrument),
        *_detector_lines(instrument),
        *_light_lines(instrument, scenario, views),
        *background_lines(instrument, scenario, views),
        *_access_lines(instrument, scenario, frames_of),
        *pointing_lines(instrument, scenario, frames_of, views),
    ]


def _camera_lines(instrument: Instrument, scenario: Scenario) -> list[str]:
    frames, camera = instrument.frames, instrument.sensor.camera
    bands = f", bands {' '.join(instrument.sensor.bands)}" if len(scenario.instruments) > 1 else ""
    width, height = (f"{np.degrees(1 / focal) * 3600:.2f}" for focal in (camera.focal_px, camera.focal_row_px))
    size = width if camera.pixel_aspect == 1 else f"{width} x {height}"
    return [
        f"  frames     {frames.count} every {frames.interval_s:g} s from {frames.start_s:g} s after the epoch{bands}",
        f"  camera     {camera.n_row} x {camera.n_col} pixels, {size} arcsec per pixel{_distortion(camera)}",
    ]


def _distortion(camera: Camera) -> str:
    """Largest distortion on the array, and whether FITS can represent it."""
    sip = sip_polynomials(camera)
    if sip is None:
        return ""
    across, down = camera.field_deg
    moved = f", distorted by up to {sip.moved_px:.3g} px, field {across:.4g} x {down:.4g} deg"
    return moved + (f", WCS good to {sip.error_px:.1g} px" if sip.error_px > ERROR_PX else "")


def _band_lines(instrument: Instrument, catalog: StarCatalog, scene: SceneDescription) -> list[str]:
    """Some lines for each band: what it is, and how many stars are brighter than its noise."""
    lines = []
    for name, band in instrument.bands.items():
        low_um, high_um = band.half_power_um
        response = "photon" if band.per_photon else "energy"
        lines.append(
            f"  band       {name}: {low_um:.4g} to {high_um:.4g} um at half power, response by {response}, mean photon "
            f"{mean_photon_j(band):.3g} J, {_photon_j(band.photon_um):.3g} J an electron; {_zero_point(band)}"
        )
        lines += _peak_lines(instrument, band, scene.band.get(name))
        if len(catalog):
            in_nei = catalog.irradiance_w_cm2(band, scene.sky.physics) / instrument.nei_w_cm2(name)
            counts = ", ".join(f"{np.count_nonzero(in_nei >= level):,} above {level} NEI" for level in LEVELS_NEI)
            per_deg2 = np.count_nonzero(in_nei >= 1.0) / SPHERE_DEG2
            lines.append(f"             stars {counts}; {per_deg2:.3g} per deg2 above the noise{_complete(in_nei)}")
    return lines


def _peak_lines(instrument: Instrument, band: Band, description: BandDescription | None) -> list[str]:
    """Peak of a response that is scaled to 1, with a note where a detector in electrons is not given it."""
    if description is None or (description.peak == 1.0 and description.files is None):
        return []
    peak, detector = description.peak, instrument.sensor.detector
    what = "its response" if description.files is None else "the product of its files"
    lines = [f"             {what} peaks at {peak:.3g}, and is scaled to 1"]
    efficiency = in_band(detector.quantum_efficiency, band.name) if isinstance(detector, ElectronDetector) else None
    if band.per_photon and peak < 1.0 == efficiency:
        text = f"detector.quantum_efficiency is 1 in band {band.name}, whose response peaks at {peak:.3g}"
        lines.append(f"  note       {text}: give it the peak")
    return lines


def _complete(in_nei: npt.NDArray[np.float64]) -> str:
    """Words that say how faint a catalog goes, and what goes further where that is above the noise."""
    faintest = complete_to(in_nei)
    if math.isnan(faintest):
        return ""
    more = ": more in sky.catalog union, synthetic, or a file" if faintest > 1.0 else ""
    return f"; complete to {faintest:.2g} NEI{more}"


def mean_photon_j(band: Band) -> float:
    """Return the mean energy of the photons that a band detects of a spectrum flat in wavelength [J]."""
    node_um, weight_um = band.quadrature_um
    return _photon_j(float(np.sum(weight_um * node_um) / np.sum(weight_um)))


def _photon_j(wavelength_um: float) -> float:
    return PLANCK_J_S * SPEED_OF_LIGHT_M_S / (wavelength_um * 1e-6)


def _zero_point(band: Band) -> str:
    if math.isnan(band.zero_mag_w_cm2):
        return f"AB magnitude 0 is {band.ab_zero_mag_w_cm2:.4g} W/cm2"
    return f"magnitude 0 is {band.zero_mag_w_cm2:.4g} W/cm2, {band.zero_mag_jy:.4g} Jy"


def _optics_lines(instrument: Instrument) -> list[str]:
    """Width of the point spread function in each band."""
    widths = []
    optics, sensor = instrument.sensor.optics, instrument.sensor
    for band in sensor.bands:
        psf = instrument.psf(band)
        if isinstance(psf, PsfGaussian):
            widths.append(f"{band} {psf.sigma_px:.3g} px")
        elif isinstance(psf, PsfAiry):
            widths.append(f"{band} {sum(p * r for p, r in zip(psf.parts, psf.radii_px, strict=True)):.3g} px")
    what = {"gaussian": "sigma", "airy": "first dark ring", "table": "an image"}[optics.psf]
    blurs = {"jitter": optics.smear_urad * 1e-6 * sensor.camera.focal_px, "diffusion": sensor.detector.diffusion_px}
    parts = [" ".join([what, ", ".join(widths)]).strip(), *(f"{name} {px:.3g} px" for name, px in blurs.items() if px)]
    return [f"  optics     {'; '.join(parts)}"]


def _fixed_pattern(instrument: Instrument) -> dict[str, float]:
    """Spread of the pixels of one image on blank sky that is the same in every frame, without bad pixels [NEI]."""
    detector = instrument.sensor.detector
    if not isinstance(detector, ElectronDetector):
        return dict.fromkeys(instrument.sensor.bands, detector.dsnu_nei) if detector.dsnu_nei else {}
    spread = {}
    for band, levels in instrument.levels.items():
        if isinstance(levels, ElectronLevels) and (detector.prnu or detector.dsnu):
            spread[band] = np.hypot(detector.prnu * levels.background_e, detector.dsnu * levels.dark_e) / levels.noise_e
    return spread


def _detector_lines(instrument: Instrument) -> list[str]:
    """Noise and saturation by band, their origin, and the enabled terms."""
    detector, all_levels = instrument.sensor.detector, instrument.levels
    bits = counted(detector.bits, "bit")
    texts = {band: f"NEI {item.nei_w_cm2:.4g}, SEI {item.sei_w_cm2:.4g} W/cm2" for band, item in all_levels.items()}
    if len(set(texts.values())) == 1:
        lines = [f"  detector   {next(iter(texts.values()))}, {bits}"]
    else:
        lines = [f"  detector   {bits}", *(f"             {band}: {text}" for band, text in texts.items())]
    for band, levels in all_levels.items():
        if isinstance(detector, ElectronDetector) and isinstance(levels, ElectronLevels):
            lines.append(
                f"  electrons  {band}: background {levels.background_e:.4g} e, dark {levels.dark_e:.4g} e, read noise "
                f"{detector.read_noise_e:g} e; noise {levels.noise_e:.4g} e of {detector.full_well_e:g}"
            )
    terms, camera = detector_terms(detector), instrument.sensor.camera
    if detector.maps_file is not None:  # one that cannot be read is an error here already
        bands = list(instrument.sensor.bands)
        read_maps(detector.maps_file, instrument.names, bands, bands, (camera.n_row, camera.n_col), every=False)
    if terms:
        lines.append(f"  pixels     {', '.join(terms.values())}")
    if detector.hits is not None:
        lines.append(f"  hits       {hit_area(detector, camera).mean:.3g} of an image, those about the array included")
    pattern = ", ".join(f"{band} {nei:.3g}" for band, nei in _fixed_pattern(instrument).items())
    if pattern:
        lines.append(f"  pattern    {pattern} NEI rms over blank pixels, the same in every frame, besides the noise")
    return lines + _level_warnings(instrument)


def _level_warnings(instrument: Instrument) -> list[str]:
    """Warnings of blank sky near an end of the scale, or of noise below its steps."""
    lines, all_levels = [], instrument.levels
    full = [band for band, levels in all_levels.items() if levels.sei_w_cm2 < 5 * levels.nei_w_cm2]
    if full:
        lines.append(f"  warning    blank sky is within 5 sigma of saturation in band {' '.join(full)}")
    if isinstance(instrument.sensor.detector, NeiDetector):
        lines += _converter_notes(instrument.sensor.detector, all_levels)
    clipped = [band for band, item in all_levels.items() if item.blank_counts < 5 * item.counts_per_nei]
    coarse = [band for band, item in all_levels.items() if item.counts_per_nei < 0.5]
    for bands, words in (
        (clipped, "offset_counts is below 5 sigma: the noise of blank sky is clipped at 0"),
        (coarse, "the noise of blank sky is below half a count: rounding shapes it"),
    ):
        where = "" if len(bands) == len(all_levels) else f" in band {' '.join(bands)}"
        lines += [f"  warning    {words}{where}"] if bands else []
    return lines


def _converter_notes(detector: NeiDetector, all_levels: Mapping[str, Levels]) -> list[str]:
    """Note about bands in which the converter's last count comes before SEI."""
    ends = {
        band: (2.0**detector.bits - 1.0 - item.blank_counts) / item.counts_per_nei * item.nei_w_cm2 / item.sei_w_cm2
        for band, item in all_levels.items()
    }
    short = ", ".join(f"{100 * end:.2g} % of it in band {band}" for band, end in ends.items() if end < 0.99)
    return [f"  note       the converter ends below SEI, at {short}: pixels saturate there"] if short else []


def _light_lines(instrument: Instrument, scenario: Scenario, views: Mapping[str, Sequence[int]]) -> list[str]:
    """Terms of the targets' light, and the quadrature over an exposure."""
    lines = [f"  light      {name}: {term.reason}" for name, term in instrument.light_terms.items()]
    sensor, exposure_s = instrument.sensor, instrument.sensor.detector.exposure_s

    def moved(span_s: float) -> tuple[float, float]:
        return longest_streaks_px(instrument, scenario.tracks, views, scenario.scene.duration_s, span_s)

    if exposure_s > 0:
        rule = instrument.exposure_rule
        instants = counted(len(rule.weight), "instant")
        lines.append(f"  exposure   {exposure_s:g} s at {instants}, error {rule.error:.0e}")
    if sensor.streaks and exposure_s > 0:
        stars_px, targets_px = moved(exposure_s)
        targets = f"targets up to {targets_px:.2g} px" if targets_px else "no target"
        lines.append(f"  streaks    stars up to {stars_px:.2g} px, {targets}, in the field of view")
    if sensor.rolls:
        line_s = abs(sensor.detector.line_time_s)
        stars_px, targets_px = (px * line_s / sensor.window_s for px in moved(sensor.window_s))
        lines.append(
            f"  read-out   {sensor.camera.n_row * line_s:g} s for all rows; from row to row stars move up to "
            f"{stars_px:.2g} px, targets up to {targets_px:.2g} px"
        )
        if max(stars_px, targets_px) > LARGEST_SHIFT_PX:
            lines.append("  warning    images of sources are drawn as of one time: their rows are off by such a shift")
    return lines


def _access_lines(instrument: Instrument, scenario: Scenario, frames_of: Mapping[str, Sequence[int]]) -> list[str]:
    """Access per sensor over the frames; for sensors without any, the constraints violated most."""
    camera = instrument.sensor.camera
    seen = {name: len(frames) for name, frames in frames_of.items() if frames}
    n_view = sum(seen.values())
    n_image = n_view * len(instrument.sensor.bands)
    size_mb = n_image * 2 * camera.n_row * camera.n_col / 1e6
    lines = [f"  access     {len(seen)} of {counted(len(frames_of), 'sensor')}, {counted(n_view, 'view')}"]
    if seen:
        lines.append("             " + ", ".join(f"{name} {count}" for name, count in seen.items()))
        lines.append(f"  output     {counted(n_image, 'image')}, {size_mb:,.0f} MB of FITS cubes")
    blind = [index for index, name in enumerate(instrument.names) if not frames_of[name]]
    if blind and scenario.targets:
        broken = _broken_rules(instrument, scenario, blind)
        rules = ", ".join(f"{rule} {part:.0%}" for rule, part in sorted(broken.items(), key=lambda kv: -kv[1]))
        lines.append(f"  no access  {counted(len(blind), 'sensor')}; part of their frames: {rules}")
    if not seen:
        lines.append("  warning    nothing would be rendered: no sensor has access in any frame")
    return lines


def _broken_rules(instrument: Instrument, scenario: Scenario, sensors: Sequence[int]) -> dict[str, float]:
    """Part of the frames of sensors, or of some of them, in which each rule excludes all targets that count then."""
    step = -(-instrument.frames.count * len(sensors) // MOST_VIEWS_OF_RULES)
    times, tracks = instrument.frame_time_s(np.arange(0, instrument.frames.count, step)), scenario.tracks
    alike: dict[tuple[tuple[float, tuple[int, ...]], ...], list[int]] = {}
    for sensor in sensors:
        alike.setdefault(tuple(instrument.access_targets(sensor)), []).append(sensor)
    n_broken: dict[str, int] = {}
    for own in alike.values():
        observers = instrument.observers(own)
        for targets, is_then in counted_targets(instrument, own[0], times):
            then = times[is_then]
            there = np.zeros(len(then), dtype=bool)
            best: dict[str, npt.NDArray[np.float64]] = {}
            for target in targets[:: -(-len(targets) // MOST_TARGETS_LOOKED_AT)]:
                exists = tracks.exist(target, then)
                there |= exists
                margins = target_margins(tracks, observers, target, instrument.access_rules, then)
                for rule, margin in margins.items():
                    best[rule] = np.maximum(best.get(rule, -np.inf), np.where(exists, margin, -np.inf))
            for rule, margin in best.items():
                n_broken[RULE_NAMES[rule]] = n_broken.get(RULE_NAMES[rule], 0) + int((margin[:, there] < 0).sum())
            n_broken["absent"] = n_broken.get("absent", 0) + len(own) * int((~there).sum())
    n_absent = n_broken.pop("absent", 0)
    n_broken |= {"absent": n_absent} if n_absent else {}
    return {rule: number / (len(sensors) * len(times)) for rule, number in n_broken.items()}
