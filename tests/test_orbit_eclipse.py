"""Eclipse against mpmath, ray casting at the ellipsoid, tangent lines in a plane, and skyfield's shadow."""

from __future__ import annotations

import mpmath as mp
import numpy as np
import pytest
from skyfield.geometry import intersect_line_and_sphere

from warpsim.constants import ASTRONOMICAL_UNIT_M, EARTH_EQUATORIAL_RADIUS_M, SUN_RADIUS_M
from warpsim.errors import InputError
from warpsim.orbit.earth import EARTH_POLAR_RADIUS_M
from warpsim.orbit.sun import covered_fraction, eclipses, sunlit_depth, sunlit_fraction

A = EARTH_EQUATORIAL_RADIUS_M
Z = np.array([0.0, 0.0, 1.0])
TILTED = np.array([0.3, 0.4, np.sqrt(0.75)])
GM = 3.986004418e14

CLOSED_FORM = 1e-12  # rounding of a share: 1e-16 rad of a disc 0.005 rad wide, some twenty times
OBLATE = 2e-5  # a round Sun in stretched axes; the pass line is 1e-3
QUADRATURE = 5e-6  # 4,000 chords of the Sun's disc
EDGE_S = 1.1e-3  # ends are halved down to the promised 1 ms and off by up to all of it; the rest is for rounding


def exact_covered(sun, earth, apart):
    """Common area of two caps over the first one's, from the classical formula in 60 digits."""
    with mp.workdps(60):
        s, e, d = (mp.mpf(float(x)) for x in (sun, earth, apart))
        if d >= s + e:
            return 0.0
        if d <= abs(e - s):
            return float(min(1, (1 - mp.cos(e)) / (1 - mp.cos(s))))
        angle = lambda a, b, c: mp.acos((mp.cos(a) - mp.cos(b) * mp.cos(c)) / (mp.sin(b) * mp.sin(c)))  # noqa: E731
        lens = 2 * (mp.pi - angle(d, s, e) - angle(e, s, d) * mp.cos(s) - angle(s, e, d) * mp.cos(e))
        return float(lens / (2 * mp.pi * (1 - mp.cos(s))))


def test_common_area_of_discs_against_mpmath(record_accuracy):
    rng = np.random.default_rng(1)
    sun = rng.uniform(0.0045, 0.0048, 400)
    earth = np.concatenate([rng.uniform(0.1, np.pi / 2, 300), rng.uniform(0.001, 0.01, 100)])
    earth[:20] = np.pi / 2
    offset = rng.uniform(-1.2, 1.2, 400)
    offset[20:140] = np.sign(offset[20:140]) * (1.0 - 10.0 ** rng.uniform(-14, -1, 120))  # first and last contact
    apart = np.abs(earth + sun * offset)
    got = covered_fraction(sun, earth, apart)
    expected = [exact_covered(*values) for values in zip(sun, earth, apart, strict=True)]
    assert np.abs(got - expected).max() < CLOSED_FORM
    error = np.abs(got - expected).max()
    record_accuracy("Fraction of the Sun's disc behind a sphere", error, CLOSED_FORM, "of the disc", "mpmath")
    assert np.count_nonzero((got > 0) & (got < 1)) > 250


def test_contact_is_smooth_and_monotone():
    sun, earth = 0.00465, 1.1
    for centre in (earth + sun, earth - sun):
        apart = centre + np.linspace(-1e-9, 1e-9, 2001)
        covered = covered_fraction(sun, earth, apart)
        assert np.all((covered >= 0) & (covered <= 1))
        assert np.diff(covered).max() < 1e-12  # no step upwards but rounding
        assert np.abs(np.diff(covered)).max() < 1e-9
    assert covered_fraction(sun, earth, earth + sun) == pytest.approx(0.0, abs=1e-12)
    assert covered_fraction(sun, earth, earth - sun) == pytest.approx(1.0, abs=1e-12)


def ray_cast_fraction(place, sun, pole, n_chord=4000):
    """Share of the Sun's cap whose rays miss the ellipsoid, by bisection along chords that run towards the Earth."""
    polar = EARTH_POLAR_RADIUS_M if pole is not None else A
    axis = Z if pole is None else pole
    way = sun - place
    distance = np.linalg.norm(way)
    ahead = way / distance
    toward = -place - (-place @ ahead) * ahead
    toward /= np.linalg.norm(toward)
    aside = np.cross(ahead, toward)
    rim = SUN_RADIUS_M / distance

    def hit(x, y):
        direction = np.sqrt(1 - x**2 - y**2)[:, None] * ahead + x[:, None] * aside + y[:, None] * toward
        shape = lambda a, b: a @ b.T + ((A / polar) ** 2 - 1) * np.multiply.outer(a @ axis, b @ axis)  # noqa: E731
        square = np.einsum("ni,ni->n", direction, direction) + ((A / polar) ** 2 - 1) * (direction @ axis) ** 2
        mixed = shape(direction, place[None])[:, 0]
        rest = shape(place[None], place[None])[0, 0] - A**2
        return (mixed < 0) & (mixed**2 >= square * rest)

    x = rim * (2 * (np.arange(n_chord) + 0.5) / n_chord - 1)
    half = np.sqrt(rim**2 - x**2)
    low, high = -half, half
    clear_all, dark_all = ~hit(x, high), hit(x, low)
    for _ in range(50):
        middle = 0.5 * (low + high)
        dark = hit(x, middle)
        low, high = np.where(dark, low, middle), np.where(dark, middle, high)
    end = np.where(clear_all, half, np.where(dark_all, -half, high))
    across = np.sqrt(1 - x**2)  # a cap's area: dx dy / cos, integrated over y
    seen = np.arcsin(end / across) + np.arcsin(half / across)
    return seen.sum() / (2 * np.arcsin(half / across)).sum()


def places_in_penumbra(n, pole, seed):
    """Places from the ground to geostationary height, with the Sun's centre within its radius of the limb."""
    rng = np.random.default_rng(seed)
    found = []
    while len(found) < n:
        sun = rng.normal(size=3)
        sun *= ASTRONOMICAL_UNIT_M / np.linalg.norm(sun)
        side = np.cross(sun, rng.normal(size=3))
        side /= np.linalg.norm(side)
        r = 6.378137e6 + 10 ** rng.uniform(4.7, 7.55)
        down = np.arcsin(A / r) + rng.uniform(-0.008, 0.008)
        place = r * (-np.cos(down) * sun / np.linalg.norm(sun) + np.sin(down) * side)
        if 0.02 < sunlit_fraction(place, sun, pole) < 0.98:
            found.append((place, sun))
    return found


@pytest.mark.parametrize("pole", [None, Z, TILTED], ids=["sphere", "upright", "tilted"])
@pytest.mark.ci
def test_share_against_rays_at_the_earth(pole, record_accuracy):
    bound = QUADRATURE + (0 if pole is None else OBLATE)
    error = [
        float(sunlit_fraction(place, sun, pole)) - ray_cast_fraction(place, sun, pole)
        for place, sun in places_in_penumbra(60, pole, 3)
    ]
    assert np.abs(error).max() < bound
    if pole is not None:
        worst = np.abs(error).max()
        record_accuracy("Fraction of the Sun's disc behind the ellipsoid", worst, bound, "of the disc", "rays")
    if pole is not None:  # the shape of the Earth matters: a sphere is off by more than the pass line
        off = [
            float(sunlit_fraction(place, sun) - sunlit_fraction(place, sun, pole))
            for place, sun in places_in_penumbra(20, pole, 3)
        ]
        assert np.abs(off).max() > 0.1


def test_full_light_umbra_and_broadcasting():
    sun = np.array([ASTRONOMICAL_UNIT_M, 0, 0])
    places = np.array([[7e6, 0, 0], [-7e6, 0, 0], [0, 7e6, 0], [-7e6, 6e6, 0], [0.0, 0.0, 7e6]])
    assert sunlit_fraction(places, sun, Z).tolist() == [1, 0, 1, 0, 1]
    assert sunlit_fraction(places[:, None], np.stack([sun, -sun]), Z).shape == (5, 2)
    assert sunlit_fraction(places[0], sun, Z).shape == ()
    assert sunlit_fraction([-6.0e6, 0, 0], sun, Z) == 0  # under the ground, at night
    assert np.isnan(sunlit_fraction([np.nan, 0, 0], sun, Z))


def test_behind_the_tip_of_the_umbra_the_eclipse_is_annular():
    sun = np.array([ASTRONOMICAL_UNIT_M, 0, 0])
    for distance in (1.5e9, 5e9):
        sine_sun, sine_earth = SUN_RADIUS_M / (ASTRONOMICAL_UNIT_M + distance), A / distance
        ring = 1 - np.sin(np.arcsin(sine_earth) / 2) ** 2 / np.sin(np.arcsin(sine_sun) / 2) ** 2
        assert 0.1 < ring < 0.95
        assert sunlit_fraction([-distance, 0, 0], sun) == pytest.approx(ring, abs=CLOSED_FORM)
        assert sunlit_fraction([-distance, 1e5, 0], sun) == pytest.approx(ring, abs=1e-8)  # a little farther away
        depth = sunlit_depth([-distance, 0.0, 0], sun)
        assert depth == pytest.approx(ring, abs=CLOSED_FORM)  # no umbra: not below 0
    assert sunlit_fraction([-1.2e9, 0, 0], sun) == 0  # before the tip


def test_depth_runs_on_beyond_the_share():
    sun = np.array([ASTRONOMICAL_UNIT_M, 0, 0])
    angle = np.linspace(0.9, 1.5, 4001)  # from anti-Sun to the side, r = 7000 km: the limb at 1.146
    place = 7e6 * np.stack([-np.cos(angle), np.sin(angle), 0 * angle], axis=-1)
    depth, share = sunlit_depth(place, sun, Z), sunlit_fraction(place, sun, Z)
    assert np.all(np.diff(depth) > 0)
    assert np.diff(depth).max() < 0.05
    assert depth[0] < -5 and depth[-1] > 5
    between = (depth > 0) & (depth < 1)
    assert np.array_equal(share[between], depth[between]) and between.sum() > 30


def circling(radius_m, start_rad=0.0):
    """A circular orbit in the plane of Sun and equator, from opposite the Sun."""
    rate = np.sqrt(GM / radius_m**3)

    def place(t):
        angle = start_rad + rate * np.asarray(t)
        return radius_m * np.stack([-np.cos(angle), np.sin(angle), 0 * angle], axis=-1)

    return place, rate


def fixed_sun(t):
    return np.broadcast_to([ASTRONOMICAL_UNIT_M, 0.0, 0.0], (*np.shape(t), 3))


@pytest.mark.parametrize("pole", [None, Z], ids=["sphere", "ellipsoid"])
@pytest.mark.parametrize("radius_m", [6.778e6, 7.976e6, 4.2164e7])
def test_contacts_of_a_circular_orbit_are_those_of_tangent_lines(radius_m, pole, record_accuracy):
    """In the plane: r sin(phi + eps) = a at the umbra's edge, sin eps = (R - a) / D; phi - kappa at the penumbra's."""
    place, rate = circling(radius_m, start_rad=-1.7)
    umbra = np.arcsin(A / radius_m) - np.arcsin((SUN_RADIUS_M - A) / ASTRONOMICAL_UNIT_M)
    penumbra = np.arcsin(A / radius_m) + np.arcsin((SUN_RADIUS_M + A) / ASTRONOMICAL_UNIT_M)
    duration_s = 2.5 * 2 * np.pi / rate
    found = eclipses(place, fixed_sun, pole, duration_s, step_s=duration_s / 200)
    assert len(found) == 3
    for turn, got in enumerate(found):
        middle_s = (1.7 + turn * 2 * np.pi) / rate
        expected = middle_s + np.array([-penumbra, -umbra, umbra, penumbra]) / rate
        inward = np.array([1, 1, -1, -1]) * (np.array(got) - expected)  # ends lie inside, within 1 ms
        assert np.all((inward > -1e-4) & (inward < EDGE_S)), inward
        record_accuracy("Beginning and end of eclipses", np.abs(inward).max(), EDGE_S, "s", "tangent lines in a plane")


def test_an_eclipse_shorter_than_a_step_is_found():
    """An orbit across the shadow's edge: it touches the penumbra for seconds, out of reach of a scan at 60 s."""
    radius_m = 7.0e6
    rate = np.sqrt(GM / radius_m**3)
    edge = np.arcsin(A / radius_m) + np.arcsin((SUN_RADIUS_M + A) / ASTRONOMICAL_UNIT_M)
    tilt = edge - 2e-5  # nearest to the axis of the shadow, at angle `tilt`

    def place(t):
        angle = rate * (np.asarray(t) - 1234.5)
        top = np.array([-np.cos(tilt), 0.0, np.sin(tilt)])
        return radius_m * (np.cos(angle)[..., None] * top + np.sin(angle)[..., None] * np.array([0, 1.0, 0]))

    found = eclipses(place, fixed_sun, None, 4000.0, step_s=60.0)
    assert len(found) == 1
    half_s = np.arccos(np.cos(edge) / np.cos(tilt)) / rate
    assert found[0].end_s - found[0].start_s == pytest.approx(2 * half_s, abs=2 * EDGE_S)
    assert found[0].start_s == pytest.approx(1234.5 - half_s, abs=EDGE_S)
    assert 2 * half_s < 30
    assert np.isnan(found[0].umbra_start_s) and np.isnan(found[0].umbra_end_s)


def test_shadow_against_skyfield():
    """Skyfield's shadow (`is_sunlit`) is that of a point Sun and a sphere: its edge halves the disc, nearly."""
    rng = np.random.default_rng(4)
    sun = np.array([0.6, 0.7, 0.39]) * ASTRONOMICAL_UNIT_M
    place = rng.normal(size=(20000, 3))
    place *= (rng.uniform(6.5e6, 1.2e7, 20000) / np.linalg.norm(place, axis=1))[:, None]
    _, far = intersect_line_and_sphere((sun - place).T, -place.T, A)
    lit = np.nan_to_num(far) <= 0
    depth = sunlit_depth(place, sun)
    assert lit[depth > 0.52].all() and not lit[depth < 0.48].any()
    assert 0.1 < np.mean(~lit) < 0.6


@pytest.mark.parametrize(("duration_s", "step_s"), [(0.0, 1.0), (10.0, np.nan)])
def test_scan_arguments_are_checked(duration_s, step_s):
    with pytest.raises(InputError, match="must be a number > 0"):
        eclipses(circling(7e6)[0], fixed_sun, None, duration_s, step_s)
