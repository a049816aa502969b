"""Which terms of a detector are on, in words."""

from __future__ import annotations

from warpsim.detector.electron import ElectronDetector
from warpsim.detector.nei import NeiDetector


def detector_terms(detector: NeiDetector | ElectronDetector) -> dict[str, str]:
    """What a detector has beyond the plain chain of its kind, by field: a few words about each."""
    shares = {
        "prnu": f"{detector.prnu:g} rms of gains",
        "dead_fraction": f"{detector.dead_fraction:g} of the pixels dead",
        "hot_fraction": f"{detector.hot_fraction:g} of the pixels hot",
        "nonlinearity": f"{detector.nonlinearity:g} of the response lost at saturation",
    }
    if isinstance(detector, ElectronDetector):
        shares |= {
            "dsnu": f"{detector.dsnu:g} rms of dark currents",
            "column_noise_e": f"{detector.column_noise_e:g} e rms by column",
        }
    else:
        shares |= {
            "dsnu_nei": f"{detector.dsnu_nei:g} NEI rms of offsets",
            "column_noise_nei": f"{detector.column_noise_nei:g} NEI rms by column",
        }
    terms = {name: words for name, words in shares.items() if getattr(detector, name) > 0}
    if isinstance(detector, ElectronDetector) and not detector.shot_noise:
        terms["shot_noise"] = "no shot noise"
    return terms
