"""How do orbits that I have already get into a scene: element sets (TLE), an ephemeris (OEM), a pattern around a seed?

    python examples/08_own_orbits.py

Writes a TLE file and an OEM as other programs would give them, mixes their satellites with a pattern of Molniya orbits,
and lets them look at a target in low orbit that releases four cubes at 900 s. Draws ground tracks and when each
satellite can observe the target over half a day.
With --quick: one hour instead of twelve.
"""

import argparse
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from astropy.time import Time

import warpsim as ws

EPOCH = "2025-06-01T00:00:00"
TLE = """\
ISS (ZARYA)
1 25544U 98067A   25152.00000000  .00001764  00000-0  38792-4 0  9996
2 25544  51.6439 211.2001 0007417  17.6667  85.6398 15.50103472202482
"""
BODY = {"shape": ws.Sphere(0.8), "surface": {"emissivity": 0.9}, "temperature": {"start_k": 300.0}}
DURATION_S = 12 * 3600.0


def write_files(folder: Path, duration_s: float) -> None:
    """What others would have given: `stations.tle` and `bird.oem`."""
    (folder / "stations.tle").write_text(TLE)
    times = np.arange(-60.0, duration_s + 61.0, 60.0)
    bird = ws.KeplerOrbit(64.0, altitude_km=1400.0, raan_deg=150.0)
    position_m, velocity_m_s = (state[:, 0] for state in bird.states(Time(EPOCH, scale="utc"), times))
    path = ws.EphemerisSegment.of_states("BIRD 1", Time(EPOCH, scale="utc"), times, position_m, velocity_m_s)
    ws.write_oem(folder / "bird.oem", path, overwrite=True)


def make_scene(folder: Path, duration_s: float) -> ws.Scene:
    """Three kinds of satellites, one target and its cubes."""
    molniya = ws.KeplerOrbit(63.4, perigee_altitude_km=1000.0, eccentricity=0.7, argument_of_perigee_deg=270.0)
    parts = [
        ws.TleSatellites(file=str(folder / "stations.tle")),
        ws.EphemerisSatellites([str(folder / "bird.oem")]),
        ws.SeedPattern(molniya, n_plane=3, n_per_plane=1, phasing=1, prefix="molniya"),
    ]
    cubes = {"name": "cube", "count": 4, **BODY, "release": {"time_s": 900.0, "speed_m_s": [0.5, 1.0]}}
    return ws.Scene(
        name="own orbits",
        epoch_utc=EPOCH,
        duration_s=duration_s,
        frames={"count": 60, "interval_s": 60.0},
        constellation=ws.MixedConstellation(parts),
        trajectory=ws.KeplerOrbit(66.0, altitude_km=600.0, raan_deg=40.0),
        targets=[{"name": "bus", **BODY}, cubes],
        camera=ws.Camera(n_row=64, n_col=64, fov_deg=0.5),
        optics=ws.Optics(aperture_m=0.5),
        detector=ws.NeiDetector(nei_w_cm2=1e-19, sei_w_cm2=3e-16),
        bands=["A"],
        access_rules=ws.AccessConstraints(min_grazing_altitude_km=100.0, min_solar_exclusion_deg=30.0),
    )


def main(output: Path, quick: bool = False) -> None:
    """Draw tracks and access to `output`."""
    duration_s = 3600.0 if quick else DURATION_S
    write_files(output.parent, duration_s)
    scene = make_scene(output.parent, duration_s)
    print(scene.access())
    figure, (tracks, access) = plt.subplots(2, 1, figsize=(10, 9), height_ratios=[2, 1], layout="constrained")
    ws.plot.plot_ground_tracks(scene, ax=tracks)
    ws.plot.plot_access(scene, ax=access)
    figure.savefig(output, dpi=150)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--output", type=Path, default=Path("08_own_orbits.png"))
    parser.add_argument("--quick", action="store_true", help="small and fast")
    options = parser.parse_args()
    main(options.output, options.quick)
