"""What a scene would give, in words: `warpsim check`."""

from __future__ import annotations

import itertools

import numpy as np

from warpsim.detector.electron import ElectronDetector
from warpsim.detector.levels import ElectronLevels
from warpsim.detector.terms import detector_terms
from warpsim.optics.camera import Camera
from warpsim.optics.psf import PsfAiry, PsfGaussian
from warpsim.optics.sip import ERROR_PX, sip_polynomials
from warpsim.orbit.arc import BallisticArc
from warpsim.orbit.earth import geodetic_altitude_m
from warpsim.orbit.rules import AccessConstraints
from warpsim.orbit.sampling import TRACK_ERROR_M
from warpsim.render.star_field import load_catalog
from warpsim.scene.exposure import exposure_rule
from warpsim.scene.movement import longest_streaks_px
from warpsim.scene.pointing import FixedPointing, TrackPointing
from warpsim.scene.scene import Scene
from warpsim.scene.view_axes import commanded_axes
from warpsim.target.mesh import Mesh
from warpsim.target.temperature import HeatBalance, TemperatureRows

ESCAPE_SPEED_M_S = 11_180.0
"""From the Earth's surface: no ballistic flight between two places starts faster."""

MOST_VIEWS_LOOKED_AT = 2000
"""Views in which the main target is looked for."""

LARGEST_ABERRATION_ARCSEC = 26.0
"""The Earth's motion and a low orbit's."""
RIGHT_ANGLE_DEFLECTION_ARCSEC = 4.07e-3
"""Bending of light 90 degrees from the Sun, seen from the Earth; elsewhere divided by tan(angle / 2)."""
LIMB_DEFLECTION_ARCSEC = 1.75

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


def scene_report(scene: Scene) -> str:
    """A few lines about a valid scene: size, orbits, access, and why frames would be empty.

    Raises:
        InputError: The star catalog cannot be read, or a path cannot be propagated.
    """
    camera = scene.camera
    things = f"{_count(len(scene.sensor_names), 'sensor')}, {_count(len(scene.target_names), 'target')}"
    lines = [
        f"{scene.name}: valid. {things}, bands {' '.join(scene.bands)}",
        f"  frames     {scene.frames.count} every {scene.frames.interval_s:g} s from {scene.frames.start_s:g} s "
        f"after {scene.epoch.isot} UTC",
        f"  camera     {camera.n_row} x {camera.n_col} pixels, "
        f"{_pixel_size(camera)} arcsec per pixel{_distortion(camera)}",
        *_optics_lines(scene),
        *_detector_lines(scene),
        *_sky_lines(scene),
        *_light_lines(scene),
        f"  orbits     nodes every {scene.tracks.step_s:g} s, interpolation error {scene.tracks.error_m * 1e3:.2g} mm",
    ]
    movers = [scene.constellation, *(group.trajectory for group in scene.groups_of_targets)]
    for mover in movers:
        notes = getattr(mover, "notes", None)
        lines += [f"  note       {note}" for note in (notes(scene.epoch, scene.duration_s) if notes else [])]
    shapes = {spec.name: spec.shape for group in scene.groups_of_targets for spec in group.targets}
    for name, shape in shapes.items():
        lines += [f"  note       {name}: {note}" for note in (shape.notes() if isinstance(shape, Mesh) else [])]
    if scene.tracks.error_m > TRACK_ERROR_M:
        rough = max((*scene.tracks.sensors, *scene.tracks.targets), key=lambda track: track.error_m)
        missed = f"near {rough.error_at_s:.6g} s interpolation is {rough.error_m * 1e3:.2g} mm off"
        lines.append(f"  warning    {rough.name} moves unevenly: {missed}")
    times = scene.frame_time_s(np.arange(scene.frames.count))
    seen = {name: np.flatnonzero(scene.has_access(name, times)).tolist() for name in scene.sensor_names}
    lines += _flight_lines(scene) + _access_lines(scene) + _pointing_lines(scene, seen)
    warning = pointing_warning(scene, seen)
    return "\n".join(lines if warning is None else [*lines, f"  warning    {warning}"])


def _pixel_size(camera: Camera) -> str:
    width, height = (f"{np.degrees(1 / focal) * 3600:.2f}" for focal in (camera.focal_px, camera.focal_row_px))
    return width if camera.pixel_aspect == 1 else f"{width} x {height}"


def _distortion(camera: Camera) -> str:
    """How far the lens moves places on the array, and whether FITS can say so."""
    sip = sip_polynomials(camera)
    if sip is None:
        return ""
    across, down = camera.field_deg
    moved = f", distorted by up to {sip.moved_px:.3g} px, field {across:.4g} x {down:.4g} deg"
    return moved + (f", WCS good to {sip.error_px:.1g} px" if sip.error_px > ERROR_PX else "")


def _optics_lines(scene: Scene) -> list[str]:
    """Width of the point spread function in each band."""
    widths = []
    for band in scene.bands:
        psf = scene.psf(band)
        if isinstance(psf, PsfGaussian):
            widths.append(f"{band} {psf.sigma_px:.3g} px")
        elif isinstance(psf, PsfAiry):
            widths.append(f"{band} {sum(p * r for p, r in zip(psf.parts, psf.radii_px, strict=True)):.3g} px")
    what = {"gaussian": "sigma", "airy": "first dark ring", "table": "an image"}[scene.optics.psf]
    blurs = {"jitter": scene.optics.smear_urad * 1e-6 * scene.camera.focal_px, "diffusion": scene.detector.diffusion_px}
    said = [" ".join([what, ", ".join(widths)]).strip(), *(f"{name} {px:.3g} px" for name, px in blurs.items() if px)]
    return [f"  optics     {'; '.join(said)}"]


def _fixed_pattern(scene: Scene) -> dict[str, float]:
    """Spread of the pixels of one image on blank sky that is the same in every frame, without bad pixels [NEI]."""
    detector = scene.detector
    if not isinstance(detector, ElectronDetector):
        return dict.fromkeys(scene.bands, detector.dsnu_nei) if detector.dsnu_nei else {}
    spread = {}
    for band, levels in scene.levels.items():
        if isinstance(levels, ElectronLevels) and (detector.prnu or detector.dsnu):
            spread[band] = np.hypot(detector.prnu * levels.background_e, detector.dsnu * levels.dark_e) / levels.noise_e
    return spread


def _detector_lines(scene: Scene) -> list[str]:
    """Noise and saturation by band, what they come from, and the terms that are on."""
    detector = scene.detector
    bits = _count(detector.bits, "bit")
    said = {band: f"NEI {item.nei_w_cm2:.4g}, SEI {item.sei_w_cm2:.4g} W/cm2" for band, item in scene.levels.items()}
    if len(set(said.values())) == 1:
        lines = [f"  detector   {said[scene.bands[0]]}, {bits}"]
    else:
        lines = [f"  detector   {bits}", *(f"             {band}: {words}" for band, words in said.items())]
    for band, levels in scene.levels.items():
        if isinstance(detector, ElectronDetector) and isinstance(levels, ElectronLevels):
            lines.append(
                f"  electrons  {band}: background {levels.background_e:.4g} e, dark {levels.dark_e:.4g} e, read noise "
                f"{detector.read_noise_e:g} e; noise {levels.noise_e:.4g} e of {detector.full_well_e:g}"
            )
    terms = detector_terms(detector)
    if terms:
        lines.append(f"  pixels     {', '.join(terms.values())}")
    pattern = ", ".join(f"{band} {nei:.3g}" for band, nei in _fixed_pattern(scene).items())
    if pattern:
        lines.append(f"  pattern    {pattern} NEI rms over blank pixels, the same in every frame, besides the noise")
    full = [band for band, levels in scene.levels.items() if levels.sei_w_cm2 < 5 * levels.nei_w_cm2]
    if full:
        lines.append(f"  warning    blank sky is within 5 sigma of saturation in band {' '.join(full)}")
    clipped = [band for band, item in scene.levels.items() if item.blank_counts < 5 * item.counts_per_nei]
    coarse = [band for band, item in scene.levels.items() if item.counts_per_nei < 0.5]
    for bands, words in (
        (clipped, "offset_counts is below 5 sigma: the noise of blank sky is clipped at 0"),
        (coarse, "the noise of blank sky is below half a count: rounding shapes it"),
    ):
        where = "" if len(bands) == len(scene.bands) else f" in band {' '.join(bands)}"
        lines += [f"  warning    {words}{where}"] if bands else []
    return lines


def _pointing_lines(scene: Scene, frames_of: dict[str, list[int]]) -> list[str]:
    """Where cameras look, and in how many of the views, or of some spread over them, the main target is."""
    pointing = scene.pointing
    if isinstance(pointing, TrackPointing):
        what = f"tracks {pointing.track}"
    else:
        what = "fixed" if isinstance(pointing, FixedPointing) else f"table, {pointing.mode}"
    jitter = f", jitter {pointing.jitter.rms_urad:g} urad" if pointing.jitter else ""
    views = [(sensor, frame) for sensor, frames in frames_of.items() for frame in frames]
    views = views[:: -(-len(views) // MOST_VIEWS_LOOKED_AT) or 1]
    n_in = 0
    for sensor, group in itertools.groupby(views, key=lambda view: view[0]):
        times = scene.frame_time_s([frame for _, frame in group])
        margin = scene.access_margins(times, sensors=[sensor], rules=AccessConstraints(in_fov=True))["fov_deg"]
        n_in += int((margin >= 0).sum())
    met = f"; main target in the field of {n_in:,} of {_count(len(views), 'view')}" if views else ""
    lines = [f"  pointing   {what}, {pointing.up} up{jitter}{met}"]
    if views and not n_in:
        lines.append("  warning    no view has the main target in the field")
    return lines


def pointing_warning(scene: Scene, frames_of: dict[str, list[int]]) -> str | None:
    """What had to be replaced in the cameras' axes, counted over the frames of each sensor; None for nothing."""
    n_up = n_boresight = n_view = 0
    for sensor, frames in frames_of.items():
        told = commanded_axes(scene, sensor, scene.frame_time_s(frames))
        n_up += int(told.up_replaced.sum())
        n_boresight += int(told.boresight_replaced.sum())
        n_view += len(frames)
    said = []
    if n_up:
        said.append(f"{_count(n_up, 'view')} of {n_view:,} with pointing.up along the line of sight, its spare is up")
    if n_boresight:
        said.append(f"{_count(n_boresight, 'view')} of {n_view:,} with no direction to track, the motion's is taken")
    return "; ".join(said) or None


def _count(n: int, noun: str) -> str:
    return f"{n:,} {noun}{'' if n == 1 else 's'}"


def _sky_lines(scene: Scene) -> list[str]:
    """Stars with light in each band; what their places include, and how much is missed by what is off."""
    catalog, sky = load_catalog(scene), scene.sky
    lit = {name: int(np.count_nonzero(catalog.irradiance_w_cm2(name, sky.physics))) for name in scene.bands}
    bands = ", ".join(f"{name} {n:,}" for name, n in lit.items())
    papers = ", the paper's physics" if sky.physics == "paper" else ""
    lines = [f"  sky        catalog {sky.catalog}: {_count(len(catalog), 'star')}, with light in band {bands}{papers}"]
    if sky.catalog != "none" and not any(lit.values()):
        lines.append("  warning    no star of the catalog gives light in these bands")
    parallax_arcsec = float(np.nan_to_num(catalog.parallax_mas).max(initial=0.0)) / 1e3
    from_sun_deg = scene.access_rules.min_solar_exclusion_deg
    deflection_arcsec, where = LIMB_DEFLECTION_ARCSEC, "at the Sun's limb"
    if from_sun_deg:
        deflection_arcsec = RIGHT_ANGLE_DEFLECTION_ARCSEC / float(np.tan(np.radians(from_sun_deg / 2)))
        where = f"{from_sun_deg:g} deg from the Sun"
    effects = {
        "aberration": (sky.aberration, LARGEST_ABERRATION_ARCSEC, ""),
        "parallax": (sky.parallax, parallax_arcsec, " for the nearest star"),
        "light deflection": (sky.light_deflection, deflection_arcsec, f" {where}"),
    }
    px_per_arcsec = max(scene.camera.focal_px, scene.camera.focal_row_px) * np.radians(1 / 3600)
    included = [name for name, (on, _, _) in effects.items() if on]
    left_out = [
        f"{name} ({_short(arcsec)} arcsec, {_short(arcsec * px_per_arcsec)} px{note})"
        for name, (on, arcsec, note) in effects.items()
        if not on and arcsec > 0
    ]
    if len(catalog):
        lines.append(
            f"  places     {', '.join(['proper motion', *included])}; left out: {', '.join(left_out) or 'nothing'}"
        )
    return lines


def _short(value: float) -> str:
    """Two digits, without an exponent where they are before the point."""
    return f"{value:.0f}" if value >= 10 else f"{value:.2g}"


def _flight_lines(scene: Scene) -> list[str]:
    """The main targets' paths, with a word where they cannot be meant."""
    tracks, lines = scene.tracks, []
    times = np.linspace(0, scene.duration_s, 400)
    for number, group in enumerate(scene.groups_of_targets):
        path = group.trajectory
        position_m, velocity_m_s = tracks.state(group.names[0], times)
        altitude_km = geodetic_altitude_m(position_m, tracks.pole_icrs) / 1e3
        # A flight's own start velocity: that of the track is a derivative of its interpolant.
        arc = path if isinstance(path, BallisticArc) else None
        speed = arc.start_speed_m_s if arc else float(np.linalg.norm(velocity_m_s[0]))
        where = f"{altitude_km.min():.1f} to {altitude_km.max():.1f} km above WGS84, start {speed:.0f} m/s"
        far = f", {arc.range_angle_deg:.2f} deg about the Earth's centre" if arc else f", {path.kind.replace('_', ' ')}"
        lines.append(f"  {'flight' if number == 0 else group.name:<10} {where}{far}")
        if arc and speed > ESCAPE_SPEED_M_S:
            lines.append(f"  warning    the flight starts faster than escape speed ({ESCAPE_SPEED_M_S:.0f} m/s)")
        if arc and altitude_km.min() < arc.endpoint_altitude_km - 0.1:
            lines.append(f"  warning    the flight dips below its end points ({arc.endpoint_altitude_km:g} km)")
        if not arc and altitude_km.min() < 0:
            lines.append(f"  warning    the path goes {-altitude_km.min():.0f} km below the ground")
    return lines


def _light_lines(scene: Scene) -> list[str]:
    """Which terms the targets' light has, and how finely an exposure is followed."""
    lines = [f"  light      {name}: {term.reason}" for name, term in scene.light_terms.items()]
    if scene.detector.exposure_s > 0:
        rule = exposure_rule(scene)
        instants = _count(len(rule.weight), "instant")
        lines.append(f"  exposure   {scene.detector.exposure_s:g} s at {instants}, error {rule.error:.0e}")
    if scene.streaks:
        stars_px, targets_px = longest_streaks_px(scene)
        lines.append(f"  streaks    stars up to {stars_px:.2g} px, targets up to {targets_px:.2g} px, in access")
    return lines + _heat_lines(scene)


def _heat_lines(scene: Scene) -> list[str]:
    """Temperatures of the targets whose heat is balanced, by kind."""
    by_kind: dict[str, list[TemperatureRows]] = {}
    for spec, rows in zip(scene.target_specs, scene.temperatures, strict=True):
        if isinstance(spec.temperature, HeatBalance):
            by_kind.setdefault(spec.name, []).append(rows)
    lines = []
    for name, kind in by_kind.items():
        low_k, high_k = min(r.temperature_k.min() for r in kind), max(r.temperature_k.max() for r in kind)
        error_k, ripple_k = max(r.error_k for r in kind), max(r.ripple_k for r in kind)
        swing = f", {ripple_k:.2g} K within a turn" if ripple_k > error_k else ""
        lines.append(f"  heat       {name}: {low_k:.1f} to {high_k:.1f} K, error {error_k:.1g} K{swing}")
    return lines


def _access_lines(scene: Scene) -> list[str]:
    """Access per sensor over the frames; for sensors without any, the rules that are broken most of the time."""
    times = scene.frame_time_s(np.arange(scene.frames.count))
    counts = {name: int(scene.has_access(name, times).sum()) for name in scene.sensor_names}
    seen = {name: count for name, count in counts.items() if count}
    n_view = sum(seen.values())
    n_image = n_view * len(scene.bands)
    size_mb = n_image * 2 * scene.camera.n_row * scene.camera.n_col / 1e6
    lines = [f"  access     {len(seen)} of {_count(len(counts), 'sensor')}, {_count(n_view, 'view')}"]
    if seen:
        lines.append("             " + ", ".join(f"{name} {count}" for name, count in seen.items()))
        lines.append(f"  output     {_count(n_image, 'image')}, {size_mb:,.0f} MB of FITS cubes")
    blind = [number for number, name in enumerate(scene.sensor_names) if not counts[name]]
    if blind:
        margins = scene.access_margins(times)
        broken = {RULE_NAMES[rule]: np.mean(margin[blind] < 0) for rule, margin in margins.items()}
        rules = ", ".join(f"{rule} {share:.0%}" for rule, share in sorted(broken.items(), key=lambda kv: -kv[1]))
        lines.append(f"  no access  {_count(len(blind), 'sensor')}; share of their frames: {rules}")
    if not seen:
        lines.append("  warning    nothing would be rendered: no sensor has access in any frame")
    return lines
