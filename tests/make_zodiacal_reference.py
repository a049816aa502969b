"""Write tests/data/zodiacal_reference.json with zodipy (GPL-3, no dependency), which `pip install zodipy` brings."""

import json
from pathlib import Path

import astropy.units as u
import numpy as np
import zodipy
from astropy.coordinates import HeliocentricMeanEcliptic, SkyCoord, get_body
from astropy.time import Time

WAVELENGTHS_UM = [1.25, 2.2, 3.5, 4.9, 8.3, 12.0, 15.0, 18.0, 25.0]
DATES = ["2010-02-15", "2026-06-21"]
N_DIRECTION = 60


def main():
    rng = np.random.default_rng(577215)
    cases = []
    for date in DATES:
        time = Time(date)
        earth = get_body("earth", time).transform_to(HeliocentricMeanEcliptic(equinox="J2000")).cartesian.xyz
        lines = rng.normal(size=(4 * N_DIRECTION, 3)) * [1, 1, 0.4]
        lines /= np.linalg.norm(lines, axis=1, keepdims=True)
        outward = earth.value / np.linalg.norm(earth.value)
        lines = lines[np.degrees(np.arccos(-lines @ outward)) > 40][:N_DIRECTION]
        sky = SkyCoord(lines, representation_type="cartesian", frame="barycentricmeanecliptic", obstime=time)
        sky = SkyCoord(sky.spherical.lon, sky.spherical.lat, frame="barycentricmeanecliptic", obstime=time)
        for wavelength_um in WAVELENGTHS_UM:
            model = zodipy.Model(wavelength_um * u.micron, gauss_quad_degree=200)
            mjy_sr = model.evaluate(sky).to_value("MJy / sr")
            cases.append(
                {
                    "date": date,
                    "earth_au": earth.to_value("au").round(9).tolist(),
                    "wavelength_um": wavelength_um,
                    "direction": lines.round(9).tolist(),
                    "mjy_sr": [float(f"{value:.6g}") for value in mjy_sr],
                }
            )
    text = json.dumps({"zodipy": zodipy.__version__ if hasattr(zodipy, "__version__") else "", "cases": cases})
    (Path(__file__).with_name("data") / "zodiacal_reference.json").write_text(text + "\n")


if __name__ == "__main__":
    main()
