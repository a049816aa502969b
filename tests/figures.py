"""Figures in tests: drawn without a display, and closed behind each test of a module that imports `close_figures`."""

import pytest

pytest.importorskip("matplotlib").use("Agg")


@pytest.fixture(autouse=True)
def close_figures():
    yield
    from matplotlib import pyplot as plt

    plt.close("all")
