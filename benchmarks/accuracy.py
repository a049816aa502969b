"""Writes docs/accuracy.md from the errors that the accuracy tests recorded.

python -m pytest -n auto -m accuracy --accuracy=docs/accuracy.json   measures
python -m benchmarks.accuracy                                        writes the page
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

TOP = Path(__file__).parents[1]
DATA = TOP / "docs" / "accuracy.json"
PAGE = TOP / "docs" / "accuracy.md"

LINES = {
    "Light on pixels": (
        "Gaussian integrated over a pixel",
        "Airy pattern integrated over a pixel",
        "Stamps as large as an error of 1e-6 asks for",
        "Table of an Airy pattern, radius 0.01 to 50 px, against its stated error",
        "Polynomials of patterns, radius 0.1 to 10 px, against their stated error",
        "Blurred pattern on any pixel, against its stated error",
        "Image of a Gaussian as point spread function",
        "Gaussian drawn by GalSim",
        "Airy pattern, band average, blur drawn by GalSim",
        "Image as point spread function drawn by GalSim",
        "Sum of a stamp",
        "Streak of a Gaussian",
        "Streak of an Airy pattern",
        "Rows read in turn",
        "Blur of TDI by a pixel",
        "Pixels of a scene",
        "Centroid of a target's light from its label",
        "Star and target of the same path and light",
    ),
    "Directions and positions": (
        "Apparent direction in low orbit, all effects",
        "Aberration",
        "Parallax",
        "Deflection of light by the Sun",
        "Space motion of stars over 100 years",
        "Stars found in a cone",
        "Gnomonic projection",
        "Position of a star, whole chain",
        "Position of a target, whole chain",
        "Centroid of a rendered star, 1024 and 6000 px per degree",
        "Distortion of a lens",
        "Direction of a pixel and back",
        "SIP polynomials of a distorted camera",
    ),
    "Light of targets": (
        "Band radiance, 50 to 6000 K",
        "Band radiance, in the kernel",
        "Jacobian of a light curve, of the largest derivative",
        "Six spectral intervals of a band, 200 to 6000 K",
        "Band radiance, 31 shipped bands, 300 to 5800 K",
        "Irradiance of magnitude 0, WISE and 2MASS",
        "Sunlight in a band, condensed",
        "Radiance of the Earth in a band",
        "Albedo of the Earth in a band",
        "Emissivity by wavelength, in a band",
        "Reflectance by wavelength, in a band",
        "Emission by wavelength, in the kernel",
        "Irradiance of stars, 19 bands",
        "Projected area",
        "Projected area, as a mesh",
        "Mean projected area",
        "Reflected area",
        "Areas of a mesh",
        "Areas of patches of a side",
        "Areas of patches of a sphere",
        "Thermal emission of a target",
        "Reflected sunlight of a target",
        "View factor of the Earth",
        "View factor of the Earth, over the ground",
        "Earth infrared, by its rule",
        "Earth albedo on a sphere",
        "Temperature by heat balance",
    ),
    "Light of stars": (
        "Light of stellar templates in bands",
        "W1 to W4 of FGK dwarfs from G, median",
        "W1 to W4 of FGK dwarfs from G, scatter",
        "W2 to W4 of M dwarfs from G, median",
        "W2 to W4 of M dwarfs from G, scatter",
        "W3 and W4 of giants from G, median",
        "W3 and W4 of giants from G, scatter",
        "G of stars from Ks, median",
        "Stars of quality 2 off by more than 0.45 mag",
        "Stars brighter than V = 3 to 7",
        "Stars brighter than V = 6 to 9",
    ),
    "Background": (
        "Zodiacal light in DIRBE's bands",
        "Zodiacal light between DIRBE's bands",
        "Zodiacal light by plates",
        "Limb of the Earth, mean over a pixel",
        "Stray light of the Earth, heat",
        "Stray light of the Earth, visible",
    ),
    "What can be measured": (
        "Cramer-Rao bounds of position and light",
        "Fits of noisy images over their bounds",
        "Scatter of fits of light curves over their bounds, less 1",
        "Derivatives of pixels by a source's position",
        "Adjoint against Jacobian",
        "Boresights fitted to stars over their bounds",
    ),
    "Motion": (
        "Attitude after 1e6 s at 5 rev/s",
        "Torque-free attitude after 1,000 rotations",
        "Body axis after 1e6 s at 5 rev/s, in the kernel",
        "Orbit with J2 over 1614 s",
        "Orbit with J2 to J4 over 1614 s",
        "Orbit with J2 over a day",
        "Orbit between its nodes",
        "End points of a ballistic arc",
        "Satellite by an element set, in GCRS axes",
        "Ends of access in the paper's scene",
        "Ends of access about close passes",
        "Fraction of the Sun's disc behind a sphere",
        "Fraction of the Sun's disc behind the ellipsoid",
        "Beginning and end of eclipses",
    ),
    "Noise": (
        "Gaussian noise, moments of 1e8 draws",
        "Gaussian noise, moments of 1e9 draws",
        "Correlation of noise, pixels of one image",
        "Correlation of noise across frames, sensors, bands, seeds",
        "Poisson noise, mean 1e-3 to 1e7, moments of 1e7 draws",
        "Poisson noise, total variation",
        "Flux of rendered stars, bias",
        "Scatter of their fluxes and places",
    ),
    "The same again": (
        "Counts of a frame alone, in any batch and order, on any number of threads",
        "Counts with any list of devices",
        "Files of a run killed twice and resumed",
        "Signal on CUDA and on the CPU",
        "The paper's Table 2, 37 values",
        "The paper's Table 2, five values",
    ),
}
"""Sections of the page, and their lines in order."""

NOTES = {
    "Light of stars": """\
The lines of W1 to W4 are measured minus predicted magnitude, the prediction from G and BP-RP alone. They stand on stars
that made no template and are not saturated: 48, 116, 280 and 173 FGK dwarfs in W1, W2, W3 and W4 (BP-RP 0.5 to 1.7),
17, 34 and 26 M dwarfs in W2, W3 and W4 (1.7 to 3.3), 47 and 57 giants in W3 and W4 (0.97 to 1.84). **Not covered**:
giants in W1 and W2 (saturated; one and five stars), M dwarfs in W1 (three stars), dwarfs hotter than BP-RP = 0.5 (seven
stars), giants redder than 1.84, whose predictions beyond 2.3 have quality 1, and the
[brightest stars of all](../catalogs/README.md#known-faults).

Counts are those of the embedded stars over the whole sky: 1 % fewer to 2.5 % more than Hipparcos has, and 6 % fewer
than Tycho-2 and UCAC4, as much as 0.05 mag between the scales of V makes.
""",
}
"""Text below the lines of a section."""

NEEDS_A_GPU = ("Signal on CUDA and on the CPU",)

HEAD = """\
# Accuracy

Written by `python -m benchmarks.accuracy` from [accuracy.json](accuracy.json), which the tests themselves wrote:

```console
python -m pytest -n auto -m accuracy --accuracy=docs/accuracy.json
```

Each line is a quantity, what it is compared with (an oracle that shares no code with it), the largest error that was
measured, the limit that its tests allow, and the margin between them, a factor. Of several cases, and of several
tests of a line, the one nearest to its limit is shown. A sigma is that of the sample. A limit of 0 means equal, bit for
bit.

Limits are what is asked for or stated, and leave room for the last bits of other processors: a margin of 2 or more over
[several of them](../tests/test_other_processors.py). Where it is smaller, the code itself works up to a bound (stamps,
stated errors, orders of polynomials, steps of orbits and temperatures), float32 of the kernels comes close to what is
asked for, the same on all of them, figures are compared as printed, or draws of fixed seeds with gates of 5 sigma.
"""

TAIL = """\
## Not measured

- **CUDA.** These figures are of the CPU. What GPUs and the CPU agree to is in performance.md; the tests run on the
  first GPU where there is one.
- **Gradients.** Images are differentiated by their sources, light curves by parameters of a target, and the two are
  chained by a sum. A target's aspect as it moves, few-electron statistics and patterns of pixels are not part of
  gradients of images. Stars' streaks are taken as straight there.

What the models themselves leave out is another matter: [physics](physics.md#left-out).
"""


def number(value: float) -> str:
    """Two digits, in a short form."""
    if 0.01 <= value < 1e4:
        return f"{value:.2g}" if value < 100 else f"{value:,.0f}"
    mantissa, _, exponent = f"{value:.1e}".partition("e")
    return f"{mantissa.removesuffix('.0')}e{int(exponent)}" if value else "0"


def row(line: dict[str, Any]) -> str:
    """A line of a table: quantity, oracle, measured, limit, margin, cases, tests."""
    measured, limit = line["measured"], line["limit"]
    margin = number(limit / measured) if limit and measured else "equal"
    tests = sorted({test.split("::")[0] for test in line["tests"]})
    links = ", ".join(f"[{Path(test).stem.removeprefix('test_')}](../{test})" for test in tests)
    error = f"{number(measured)} {line['unit']}".strip()
    cells = (line["name"], line["oracle"], error, number(limit), margin, str(line["n_case"]), links)
    return "| " + " | ".join(cells) + " |"


def page(data: dict[str, Any]) -> str:
    """The whole page."""
    known = {line["name"]: line for line in data["lines"]}
    versions = ", ".join(f"{name} {version}" for name, version in data["packages"].items())
    parts = [HEAD, f"Python {data['python']} on {data['machine']}; {versions}.", ""]
    for title, names in LINES.items():
        parts += [f"## {title}", "", "| quantity | against | error | limit | margin | cases | tests |"]
        parts += ["|---|---|---|---|---|---|---|"]
        parts += [row(known[name]) for name in names if name in known]
        parts += ["", NOTES[title]] if title in NOTES else [""]
    return "\n".join([*parts, TAIL])


def main() -> None:
    """Write the page."""
    PAGE.write_text(page(json.loads(DATA.read_text("utf-8"))), "utf-8")
    print(f"written: {PAGE}")


if __name__ == "__main__":
    main()
