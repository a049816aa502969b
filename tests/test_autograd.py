"""`ws.torch.render` and `ws.jax.render`: images of `ws.deposit`, gradients of `ws.deposit_gradient`."""

import importlib
import sys

import numpy as np
import pytest

import warpsim as ws

SHAPE = (24, 32)
PSFS = [ws.PsfGaussian(0.8), ws.PsfGaussian(1.3)]


def sources(seed=0):
    rng = np.random.default_rng(seed)
    return rng.uniform(2, 20, (3, 5, 2)), rng.uniform(0.5, 2, (3, 2, 5)).astype(np.float32)


def expected(xy, flux, cotangent):
    """Images, and gradients by positions and flux, view by view and band by band."""
    image, by_xy, by_flux = np.zeros((3, 2, *SHAPE)), np.zeros(xy.shape), np.zeros(flux.shape)
    for view, band in np.ndindex(3, 2):
        given = (xy[view], flux[view, band], PSFS[band], SHAPE)
        image[view, band] = ws.deposit(*given)
        found = ws.deposit_gradient(*given, cotangent[view, band])
        by_xy[view] += found.xy_px
        by_flux[view, band] = found.flux
    return image, by_xy, by_flux


ROUNDING = 2e-6
"""float32 images and gradients; `deposit` scales flux first."""


def close(found, wanted):
    np.testing.assert_allclose(found, wanted, rtol=ROUNDING, atol=ROUNDING * np.abs(wanted).max())


def test_torch_renders_and_differentiates():
    torch = pytest.importorskip("torch")
    xy, flux = sources()
    cotangent = np.random.default_rng(1).normal(size=(3, 2, *SHAPE)).astype(np.float32)
    image, by_xy, by_flux = expected(xy, flux, cotangent)
    for dtype in (torch.float64, torch.float32):
        places = torch.tensor(xy, dtype=dtype, requires_grad=True)
        light = torch.tensor(flux, requires_grad=True)
        drawn = ws.torch.render(places, light, PSFS, SHAPE)
        assert drawn.dtype == torch.float32 and tuple(drawn.shape) == image.shape
        (drawn * torch.tensor(cotangent)).sum().backward()
        assert places.grad.dtype == dtype
        if dtype == torch.float64:
            close(drawn.detach().numpy(), image)
            close(places.grad.numpy(), by_xy)
            close(light.grad.numpy(), by_flux)
        else:
            np.testing.assert_allclose(places.grad.numpy(), by_xy, rtol=1e-4, atol=1e-5 * np.abs(by_xy).max())


def test_torch_shares_memory_and_fits():
    """Positions of a blurred pair by gradient descent in PyTorch; the image is a tensor of its own memory."""
    torch = pytest.importorskip("torch")
    true = torch.tensor([[[10.2, 9.7], [12.6, 11.1]]], dtype=torch.float64)
    light = torch.tensor([[[1.0, 0.8]]])
    image = ws.torch.render(true, light, PSFS[0], SHAPE)
    copy = image.clone()
    ws.torch.render(true + 3, light, PSFS[0], SHAPE)
    assert torch.equal(image, copy)
    fit = (true + 0.4).requires_grad_()
    solver = torch.optim.LBFGS([fit], max_iter=60, tolerance_grad=1e-12, tolerance_change=1e-14)

    def loss():
        solver.zero_grad()
        value = ((ws.torch.render(fit, light, PSFS[0], SHAPE) - image).double() ** 2).sum()
        value.backward()
        return value

    solver.step(loss)
    assert (fit - true).abs().max() < 1e-4
    strided = (
        torch.tensor(np.asfortranarray(true.numpy().repeat(2, axis=0))).transpose(0, 1).contiguous().transpose(0, 1)
    )
    assert torch.equal(ws.torch.render(strided, light.repeat(2, 1, 1), PSFS[0], SHAPE)[1:], image)


def test_jax_renders_and_differentiates():
    jax = pytest.importorskip("jax")
    xy, flux = sources(4)
    cotangent = np.random.default_rng(1).normal(size=(3, 2, *SHAPE)).astype(np.float32)
    image, by_xy, by_flux = expected(xy, flux, cotangent)

    def value(places, light):
        return (ws.jax.render(places, light, PSFS, SHAPE) * cotangent).sum()

    with jax.enable_x64(True):
        close(np.asarray(ws.jax.render(jax.numpy.asarray(xy), flux, PSFS, SHAPE)), image)
        for slope in (jax.grad(value, (0, 1)), jax.jit(jax.grad(value, (0, 1)))):
            found = slope(jax.numpy.asarray(xy), jax.numpy.asarray(flux))
            close(np.asarray(found[0]), by_xy)
            close(np.asarray(found[1]), by_flux)
        both = jax.vmap(lambda places: ws.jax.render(places, flux, PSFS, SHAPE))(jax.numpy.stack([xy, xy]))
        close(np.asarray(both[1]), image)
    found = jax.grad(value)(jax.numpy.asarray(xy, dtype=np.float32), jax.numpy.asarray(flux))
    assert found.dtype == np.float32
    np.testing.assert_allclose(np.asarray(found), by_xy, rtol=1e-4, atol=1e-5 * np.abs(by_xy).max())


@pytest.mark.parametrize("name", ["torch", "jax"])
def test_bad_sources_are_one_line(name):
    library = pytest.importorskip(name)
    module = getattr(ws, name)
    array = library.tensor if name == "torch" else library.numpy.asarray
    xy, flux = sources()
    cases = [
        ((array(xy[0]), array(flux), PSFS, SHAPE), r"xy_px: must have shape \(n_view, n, 2\)"),
        ((array(xy), array(flux[:, :1]), PSFS, SHAPE), r"flux: must have shape \(3, 2, 5\)"),
        ((array(xy), array(flux), [], SHAPE), "psf: must be one for each band"),
        ((array(xy), array(flux), "airy", SHAPE), "psf: must be a PsfGaussian"),
        ((array(xy), array(flux), PSFS, (0, 3)), "shape: must be"),
        ((array(xy), array(flux), PSFS, SHAPE, 2.0), "flux_error: must be in"),
    ]
    for args, text in cases:
        with pytest.raises(ws.InputError, match=text):
            module.render(*args)


@pytest.mark.parametrize(("name", "words"), [("torch", "PyTorch"), ("jax", "JAX")])
def test_missing_libraries_are_named(name, words, monkeypatch):
    monkeypatch.setitem(sys.modules, name, None)
    module = importlib.import_module(f"warpsim.{name}")
    with pytest.raises(ws.InputError, match=rf"needs {words}: pip install 'warpsim\[{name}\]'"):
        module.render(None, None, PSFS, SHAPE)
