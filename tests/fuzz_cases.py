"""Small whole scenes, recipes and files, and what a hostile world makes of them; case k of a seed is the same."""

from __future__ import annotations

import copy
import functools
import gzip
import io
import json
import random
import re
from typing import Any, NamedTuple

import numpy as np
from element_sets import iss
from exchange_samples import ATTITUDES, EPHEMERIDES, OEM_XML

SCENE: dict[str, Any] = {
    "name": "small", "epoch_utc": "2025-03-20T12:00:00", "duration_s": 60.0, "bands": ["A"], "seed": 1,
    "frames": {"count": 6, "interval_s": 10.0},
    "constellation": {"kind": "walker", "n_satellite": 4, "n_plane": 2, "phasing": 1, "altitude_km": 1400.0,
                      "inclination_deg": 65.0},
    "camera": {"n_row": 32, "n_col": 48, "fov_deg": 2.0},
    "optics": {"aperture_m": 0.3, "psf": "gaussian", "sigma_px": 0.8},
    "detector": {"kind": "nei", "nei_w_cm2": 1e-18, "sei_w_cm2": 3e-15},
    "pointing": {"track": "main"},
    "trajectory": {"kind": "ballistic_arc", "start_lon_lat_deg": [10.0, 50.0], "end_lon_lat_deg": [30.0, 60.0],
                   "duration_s": 600.0, "endpoint_altitude_km": 120.0},
    "targets": [{"name": "ball", "shape": {"kind": "sphere", "radius_m": 0.5}, "surface": {"emissivity": 0.9},
                 "temperature": {"start_k": 300.0}}],
    "access_rules": {"max_range_km": 9000.0},
    "sky": {"catalog": "none"},
}  # fmt: skip

LINES = iss("25079.50000000")

PARTS: dict[str, Any] = {
    "ephemeris": {"constellation": {"kind": "ephemeris_files", "files": ["orbit.oem"]}},
    "elements": {"trajectory": {"kind": "elements", "perigee_altitude_km": 600.0, "eccentricity": 0.3,
                                "inclination_deg": 60.0, "argument_of_perigee_deg": 10.0}},
    "state": {"trajectory": {"kind": "state_vector", "position_m": [7e6, 0.0, 0.0], "velocity_m_s": [0.0, 5e3, 5e3]}},
    "set": {"trajectory": {"kind": "tle_orbit", "lines": list(LINES)}},
    "pattern": {"constellation": {"kind": "seed_pattern", "n_plane": 2, "n_per_plane": 2, "phasing": 1,
                                  "seed": {"kind": "elements", "altitude_km": 700.0, "inclination_deg": 98.0}}},
    "listed": {"constellation": {"kind": "listed", "satellites": [
        {"name": "low", "orbit": {"kind": "elements", "altitude_km": 700.0, "inclination_deg": 98.2}}]}},
    "table": {"pointing": {"kind": "table", "mode": "scan", "rows": [
        {"time_s": 0.0, "azimuth_deg": 80.0, "elevation_deg": -25.0},
        {"time_s": 60.0, "azimuth_deg": 100.0, "elevation_deg": -25.0}]}},
    "schedule": {"pointing": {"kind": "schedule", "slew": {"max_rate_deg_s": 1.0, "max_acceleration_deg_s2": 0.2,
                                                           "settle_s": 1.0},
                              "steps": [{"start_s": 0.0, "track": "main"},
                                        {"start_s": 30.0, "ra_dec_deg": [10.0, 5.0]}]}},
    "errors": {"pointing": {"track": "main", "bias": {"rms_urad": 5.0}, "drift": {"rms_urad_s": 20.0, "reset_s": 10.0},
                            "jitter": {"rms_urad": 20.0, "correlation_s": 0.1}}},
    "exposure": {"detector": {"kind": "nei", "nei_w_cm2": 5e-18, "sei_w_cm2": 5e-14, "exposure_s": 0.01,
                              "line_time_s": 2e-5}},
    "electron": {"detector": {"kind": "electron", "exposure_s": 0.1, "full_well_e": 2e5, "gain_e_per_count": 12.0,
                              "bits": 14, "quantum_efficiency": 0.6, "dark_e_s": 1e4, "read_noise_e": 200.0,
                              "hits": {"rate_cm2_s": 5.0, "thickness_um": 12.0, "e_per_um": 120.0,
                                       "pixel_pitch_um": 30.0},
                              "flicker": {"fraction": 1e-3, "e_s": 5e4, "duty": 0.4, "dwell_frames": 2}}},
    "heat": {"targets": [{"name": "tank", "shape": {"kind": "cylinder", "radius_m": 0.25, "height_m": 1.0},
                          "surface": {"reflectance": {"A": 0.3}}, "attitude": {"rolling_rev_s": 0.1, "axis": "random"},
                          "temperature": {"kind": "heat_balance", "start_k": "equilibrium", "mass_kg": 15.0,
                                          "heat_capacity_j_kg_k": 900.0, "solar_absorptance": 0.35}}]},
    "group": {"release": {"speed_m_s": [2.0, 5.0], "time_s": 10.0}, "targets": [
        SCENE["targets"][0],
        {"name": "cone", "count": 5, "shape": {"kind": "cone", "radius_m": 0.25, "height_m": 1.0},
         "surface": {"reflectance": 0.3}, "temperature": {"start_k": 350.0, "end_k": 328.0},
         "attitude": {"spin_rev_s": 3.0, "precession_rev_s": 1.0, "precession_angle_deg": 3.0}}]},
    "many": {"pointing": {"track": "group"}, "targets": [
        SCENE["targets"][0],
        {**SCENE["targets"][0], "name": "bit", "count": 40, "attitude": {"rolling_rev_s": 1.0, "axis": "random"},
         "temperature": {"kind": "heat_balance", "start_k": 300.0, "mass_kg": 1.0, "heat_capacity_j_kg_k": 900.0}}],
        "detector": {"kind": "nei", "nei_w_cm2": 1e-18, "sei_w_cm2": 3e-15, "exposure_s": 0.1}},
    "airy": {"optics": {"aperture_m": 0.3, "obscuration": 0.2, "smear_urad": 10.0}, "bands": ["A", "own"],
             "band": {"own": {"half_power_um": [8.0, 9.0]}}, "camera": {"n_row": 32, "n_col": 48, "fov_deg": 2.0,
                                                                        "distortion": {"k1": -0.1, "p1": 0.01}}},
    "light": {"background": {"zodiacal": True, "earth": True, "stray_light": {
        "angle_deg": [0, 10, 30, 60, 90, 180], "ratio_sr": [1e-1, 1e-3, 1e-5, 1e-6, 1e-7, 1e-8]}},
        "sky": {"catalog": "synthetic", "synthetic": {"n_star": 1000}}},
}  # fmt: skip
"""Changes of the scene, any of which a case may have."""

RECIPE: dict[str, Any] = {
    "scene": "scene.json", "n_sequence": 4, "n_frame": 4, "interval_s": 0.1, "seed": 7, "masks": True,
    "split": {"train": 0.5, "test": 0.5},
    "sample": {"detector.nei_w_cm2": {"log_uniform": [1e-18, 3e-18]}, "optics.aperture_m": {"uniform": [0.3, 0.5]},
               "targets.0.shape.radius_m": {"normal": [0.5, 0.1]}, "camera.n_row": {"integer": [16, 32]},
               "pointing.up": {"choice": ["zenith", "north"], "weights": [3, 1]}},
}  # fmt: skip

CSV_STARS = "ra_deg,dec_deg,flux_A_jy,pm_ra_mas_yr,pm_dec_mas_yr\n10.0,20.0,1.0,1,2\n200.0,-30.0,0.5,3,4\n"

TETRAHEDRON = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
PLY = (
    "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\nelement face 4\n"
    "property list uchar int vertex_indices\nend_header\n"
    "0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n"
)


@functools.cache
def files() -> dict[str, dict[str, bytes]]:
    """Whole files by what they are, and by their names."""
    spot = np.exp(-0.5 * np.add.outer(np.linspace(-3, 3, 15) ** 2, np.linspace(-3, 3, 15) ** 2))
    stars = CSV_STARS.encode()
    return {
        "psf": {"psf.fits": _fits(spot), "psf.npy": _npy(spot)},
        "maps": {"maps.fits": _fits(None, GAIN=np.ones((32, 48)), BAD=np.zeros((32, 48), np.uint8))},
        "image": {"image.fits": _fits(np.full((32, 48), 1e-18)), "image.npy": _npy(np.full((32, 48), 1e-18))},
        "sky_map": {"map.fits": _fits(np.ones((8, 8)), sky=True)},
        "catalog": {"stars.csv": stars, "stars.csv.gz": gzip.compress(stars, mtime=0), **_star_tables()},
        "orbit": _orbits(),
        "attitude": {f"turn.{name}": text.encode() for name, text in ATTITUDES.items()},
        "sets": {"sets.tle": "\n".join(("ISS", *LINES, "")).encode()},
        "mesh": {"body.obj": TETRAHEDRON.encode(), "body.ply": PLY.encode(), "body.stl": _stl()},
        "curve": {"curve.csv": b"wavelength_um,response\n8.0,0.0\n8.5,1.0\n9.0,0.0\n"},
    }


def _orbits() -> dict[str, bytes]:
    """A circle of 7,000 km by rows 20 s apart, in every format; others as they are in other tests."""
    rate, rows = np.sqrt(398600.4418 / 7000.0**3), []
    for time_s in range(0, 200, 20):
        c, s = 7000.0 * np.cos(rate * time_s), 7000.0 * np.sin(rate * time_s)
        rows.append(
            (f"2025-03-20T12:{time_s // 60:02d}:{time_s % 60:02d}", time_s, (c, s, 0.0, -rate * s, rate * c, 0.0))
        )
    states = [(date, time_s, " ".join(f"{number:.9f}" for number in state)) for date, time_s, state in rows]
    utc, seconds = ("\n".join(f"{row[k]} {row[2]}" for row in states) for k in (0, 1))
    oem = EPHEMERIDES["oem"].split("COMMENT states")[0].replace("12:01:00", "12:00:00") + utc + "\n"
    stk = EPHEMERIDES["e"].split("BEGIN SegmentBoundaryTimes")[0].replace("Points 5", "Points 10")
    csv = "time_s x_km y_km z_km vx_km_s vy_km_s vz_km_s\n".replace(" ", ",") + seconds.replace(" ", ",") + "\n"
    found = {"oem": oem, "e": f"{stk}EphemerisTimePosVel\n{seconds}\nEND Ephemeris\n", "csv": csv, "oem.xml": OEM_XML}
    return {f"orbit.{name}": text.encode() for name, text in (found | {"ecsv": EPHEMERIDES["ecsv"]}).items()}


def _fits(image: Any, sky: bool = False, **more: Any) -> bytes:
    from astropy.io import fits

    units = fits.HDUList([fits.PrimaryHDU(image), *(fits.ImageHDU(data, name=name) for name, data in more.items())])
    if sky:
        units[0].header.update(CTYPE1="RA---TAN", CTYPE2="DEC--TAN", CRVAL1=10.0, CRVAL2=20.0, CRPIX1=4.5, CRPIX2=4.5,
                               CDELT1=-0.1, CDELT2=0.1, BUNIT="MJy/sr")  # fmt: skip
    out = io.BytesIO()
    units.writeto(out)
    return out.getvalue()


def _npy(image: Any) -> bytes:
    out = io.BytesIO()
    np.save(out, image)
    return out.getvalue()


def _star_tables() -> dict[str, bytes]:
    from astropy.table import Table

    names, *rows = (line.split(",") for line in CSV_STARS.split())
    table, found = Table(np.array(rows, float), names=names), {}
    for name, kind in (("stars.fits", "fits"), ("stars.vot", "votable"), ("stars.ecsv", "ascii.ecsv")):
        out = io.StringIO() if kind == "ascii.ecsv" else io.BytesIO()
        table.write(out, format=kind)
        found[name] = out.getvalue().encode() if isinstance(out, io.StringIO) else out.getvalue()
    return found


def _stl() -> bytes:
    corner = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], np.float32)
    facets = [
        b"\0" * 12 + corner[list(face)].tobytes() + b"\0\0" for face in ((0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3))
    ]
    return b"\0" * 80 + (4).to_bytes(4, "little") + b"".join(facets)


NUMBERS = (
    0, -1, 1, 7, 10**400, -(10**25), 2**63, 2**31, 10**9, 1e-300, 1e300, -1e300, 1e-30, 1e30, 1e18, 1e12, 1e6, 1e-6,
    1e-12, 1e39, 3.5e38, 1.7e308, 5e-324, float("nan"), float("inf"), -0.0, 0.5, 90.0, 180.0, 360.0, -1e-9, 3e8,
)  # fmt: skip
TEXTS = (
    "", "\x1b[31mred\x1b[0m", "two\nlines", "../../out", "/etc/passwd", "a/b", "..", "x" * 300, "\u202eright", "nul\0",
    "ü", "bell\x07", "python:os:system", "none", "\ud800", "main", "A", "${HOME}", "%s%n", "\x9b31m",
)  # fmt: skip
BYTES = (
    b"NaN", b" 1e999 ", b"-", b"\n", b"=", b"\xff\xfe", b"\0", b"<x>", b"&a;", b"_", b"\x1b[31m", b"9" * 400,
    b"99999999", b" -5", b"1e300", b",", b"'", b'"', b"(", b"\r", b"inf", b"4294967295", b"\x7f\xff\xff\xff",
)  # fmt: skip


class Case(NamedTuple):
    """What to run, and the files that lie in its folder."""

    kind: str
    arguments: tuple[str, ...]
    files: dict[str, bytes]


def case(seed: int, number: int) -> Case:
    """The case of that number."""
    rng = random.Random(f"{seed}:{number}")
    kind = rng.choice(["scene", "scene", "scene", "recipe", *files()])
    if kind not in ("scene", "recipe"):
        name = rng.choice(sorted(files()[kind]))
        one = of_file(kind, name, rng.choice(ARGUMENTS.get(kind, (CHECK,))))
        return one._replace(files={**one.files, name: wounded(rng, one.files[name])})
    one = of_scene(rng.sample(sorted(PARTS), rng.choice((0, 1, 1, 2))), rng.choice(ARGUMENTS["scene"]))
    if kind == "recipe":
        changed = {"recipe.json": _hostile(rng, copy.deepcopy(RECIPE))}
        return Case(kind, ("check", "recipe.json"), {**one.files, **changed})
    return one._replace(files={**one.files, "scene.json": _hostile(rng, json.loads(one.files["scene.json"]))})


CHECK = ("check", "scene.json")
RENDER = ("render", "scene.json", "-o", "out", "--frames", "0:1", "--every-frame", "--quiet", "--device", "cpu")
ARGUMENTS: dict[str, tuple[tuple[str, ...], ...]] = {
    "scene": (CHECK,) * 6 + (("access", "scene.json"), ("czml", "scene.json", "-o", "out.czml")),
    "catalog": (CHECK, ("catalog", "{}")),
    "psf": (CHECK, RENDER),
    "maps": (CHECK, RENDER),
    "mesh": (CHECK, RENDER),
}


def whole_cases() -> list[Case]:
    """Every seed without damage."""
    found = [of_scene([part], arguments) for part in sorted(PARTS) for arguments in dict.fromkeys(ARGUMENTS["scene"])]
    recipe = Case("recipe", ("check", "recipe.json"), {"scene.json": _json(SCENE), "recipe.json": _json(RECIPE)})
    for kind, named in files().items():
        found += [of_file(kind, name, arguments) for name in named for arguments in ARGUMENTS.get(kind, (CHECK,))]
    return [*found, recipe]


def of_scene(parts: list[str], arguments: tuple[str, ...]) -> Case:
    """The scene with some parts changed."""
    scene = copy.deepcopy(SCENE)
    for name in parts:
        scene.update(copy.deepcopy(PARTS[name]))
    return Case("scene", arguments, {"orbit.oem": files()["orbit"]["orbit.oem"], "scene.json": _json(scene)})


def of_file(kind: str, name: str, arguments: tuple[str, ...]) -> Case:
    """The scene or command that reads a file."""
    data, scene = files()[kind][name], copy.deepcopy(SCENE)
    if kind == "catalog":
        arguments = tuple(word.format(name) for word in arguments)
        scene["sky"] = {"catalog": name}
    elif kind == "psf":
        scene["optics"] = {"aperture_m": 0.3, "psf": "table", "psf_file": name, "psf_oversample": 3.0}
    elif kind == "maps":
        scene["detector"]["maps_file"] = name
    elif kind in ("image", "sky_map"):
        scene["background"] = {kind: name}
    elif kind == "orbit":
        scene["constellation"] = {"kind": "ephemeris_files", "files": [name]}
    elif kind == "attitude":
        scene["targets"][0].update(
            shape={"kind": "cone", "radius_m": 0.2, "height_m": 1.0}, attitude={"kind": "table", "file": name}
        )
    elif kind == "sets":
        scene["constellation"] = {"kind": "tle", "file": name}
    elif kind == "mesh":
        scene["targets"][0]["shape"] = {"kind": "mesh", "file": name}
    else:
        scene["band"], scene["bands"] = {"own": {"file": name}}, ["own"]
    return Case(kind, arguments, {"scene.json": _json(scene), name: data})


def _json(data: Any) -> bytes:
    return json.dumps(data).encode()


def _hostile(rng: random.Random, data: dict[str, Any]) -> bytes:
    """A description with one to three wrong values, or with wounds of its text."""
    if rng.random() < 0.15:
        return wounded(rng, _json(data))
    for _ in range(rng.randint(1, 3)):
        holder, key = rng.choice(_leaves(data))
        change = rng.randrange(10)
        if change == 0 and isinstance(holder, dict):
            del holder[key]
        elif change == 1 and isinstance(holder, dict):
            holder[rng.choice(TEXTS)] = holder.pop(key)
        elif change == 2:
            holder[key] = rng.choice(
                ([], {}, [holder[key]] * 3, None, True, [[1.0]], {"kind": "table"}, list(NUMBERS[:5]))
            )
        elif isinstance(holder[key], str) and rng.random() < 0.8:
            holder[key] = rng.choice(TEXTS)
        elif isinstance(holder[key], int | float) and rng.random() < 0.4:
            factors = (-1, 0.5, 2, 10, 1000, 1e-3, 1e6, 1e9) if abs(holder[key]) < 1e290 else (-1, 2)
            holder[key] = holder[key] * rng.choice(factors)
        else:
            holder[key] = rng.choice(NUMBERS) if rng.random() < 0.85 else rng.choice(TEXTS)
    return _json(data)


def _leaves(data: Any) -> list[tuple[Any, Any]]:
    """Every table or list with each key or index in it, leaves twice."""
    pairs = list(data.items()) if isinstance(data, dict) else list(enumerate(data))
    found = []
    for key, value in pairs:
        found.append((data, key))
        found += _leaves(value) if isinstance(value, dict | list) else [(data, key)] * 2
    return found


def wounded(rng: random.Random, data: bytes) -> bytes:
    """Bytes changed, cut out, doubled or put in, cards or lines lost, the end cut, one to three times."""
    for _ in range(rng.randint(1, 3)):
        head = len(data) if rng.random() < 0.5 else min(len(data), 3000)  # headers are what is worth damage
        a = rng.randrange(max(head, 1))
        b = min(a + rng.choice((1, 3, 10, 80, 2880)), len(data))
        put = rng.choice((b"", bytes([rng.randrange(256)]), data[a:b] * 2, rng.choice(BYTES)))
        wound = rng.randrange(8)
        if wound == 0:
            data = data[:b] or b"x"
        elif wound == 1:
            data += rng.choice((b"\0" * 100, b"\n", data[a:b], rng.choice(BYTES)))
        elif wound == 2:  # as long as before: what follows stays where it is
            put = rng.choice((b"-1", b"9" * 9, b"T", b"32", b"-64", b"999", b"0", bytes([rng.randrange(256)])))
            data = data[:a] + put + data[a + len(put) :]
        elif wound == 3 and any(digits := [k for k, byte in enumerate(data[:head]) if 48 <= byte < 58]):
            k = rng.choice(digits)
            data = data[:k] + bytes([rng.randrange(48, 58)]) + data[k + 1 :]
        elif wound in (4, 5) and (words := list(re.finditer(rb"[-+.\w]*\d[-+.\w]*", data[: 10 * head]))):
            word = rng.choice(words)
            put = rng.choice((*map(str.encode, map(str, NUMBERS[1:])), *BYTES, rng.choice(words)[0]))
            data = data[: word.start()] + put + data[word.end() :]
        else:
            data = data[:a] + put + data[b:]
    return data
