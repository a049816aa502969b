"""Heat balance: cooling against closed forms, whole scenes against scipy with forces of their own, turning bodies."""

import itertools

import numpy as np
import pytest
from bodies import ground_m, unit_vectors
from conftest import slow
from refusals import refused_in_one_line
from scipy.integrate import quad, solve_ivp
from scipy.spatial.transform import Rotation

import warpsim as ws
from warpsim.constants import STEFAN_BOLTZMANN_W_M2_K4
from warpsim.target.attitude import body_motion
from warpsim.target.cooling import ERROR_K, ThermalNodes, integrate
from warpsim.target.heat_balance import LumpedNode, mean_view_factor
from warpsim.target.rotating_area import RotatingArea, commensurate_turns, steady_area
from warpsim.target.temperature import TemperatureRows

SEED = 271828
SIGMA = 5.670374419184429e-8  # CODATA 2018
AU_M, SUN_W_M2 = 149_597_870_700.0, 1361.0

PASS_K = 1e-3
"""The bound that every course keeps: steps are shortened until they err by less, here by 0.4 to 0.7 of it. Rounding,
1e-13 K a step, moves neither the steps nor the errors."""
ORACLE_K = 2e-5  # of the integration by scipy, tolerances 1e-11, forces with kinks
ROUNDING = 1e-14
MEAN_RTOL = 2e-5  # a lattice of 17,711 points over an area with kinks; 1.1e-5 for the thinnest disc
PATH_RTOL = 1e-6  # 4,096 points along one path
TABLE_RTOL = 2e-7  # means between nodes of the Sun's way


# The equation alone


def dark(settling_s, start_k=300.0):
    """A body that only cools; small differences at 300 K decay with the time given."""
    return ThermalNodes(lambda time_s: np.zeros((1, len(time_s))), 1 / (4 * start_k**3 * settling_s)), np.array(
        [start_k]
    )


@pytest.mark.parametrize("settling_s", [0.01, 10.0, 1e3, 1e6])
@pytest.mark.parametrize("start_k", [300.0, 1e4])
def test_cooling_in_the_dark(settling_s, start_k):
    """T = (T0^-3 + 3 k t)^(-1/3), from foils to bodies that hardly cool, over six hours."""
    bodies, _ = dark(settling_s)
    course = integrate(bodies, np.array([start_k]), [0.0, 21_600.0], 60.0)
    rows = TemperatureRows(course.time_s, course.temperature_k[0], course.error_k)
    time = np.concatenate([np.geomspace(1e-6, 21_600.0, 4000), np.random.default_rng(SEED).uniform(0, 21_600.0, 4000)])
    exact = (start_k**-3 + 3 * bodies.cooling_k3_s * time) ** (-1 / 3)
    worst_k = np.abs(rows.at(time) - exact).max()
    assert worst_k < PASS_K
    assert worst_k < 1.3 * course.error_k + 1e-9 <= PASS_K * 1.3 + 1e-9  # the error that is told is the true one
    assert len(course.time_s) < 8000


@pytest.mark.slow
@pytest.mark.parametrize("settling_s", [0.1, 10.0, 3e3])
def test_heating_that_swings_and_jumps_against_scipy(settling_s):
    """Smooth swings, kinks at no known time, and two bodies whose kinks differ."""
    bodies = dark(settling_s)[0]
    still = bodies.cooling_k3_s * 300.0**4

    def heating(time_s):
        swings = 1 + 0.3 * np.sin(time_s / 400.0) + 0.2 * np.abs(np.sin(time_s / 777.0))
        fall = [np.clip((time_s - at) / 9.0, 0, 1) * np.clip((4000.0 - time_s) / 15.0, 0, 1) for at in (1500.0, 1522.0)]
        return still * (swings - 0.8 * np.stack(fall))

    course = integrate(ThermalNodes(heating, bodies.cooling_k3_s), np.array([300.0, 250.0]), [0.0, 7000.0], 60.0)
    assert course.error_k <= ERROR_K
    kinks = [0.0, 1500.0, 1509.0, 1522.0, 1531.0, 3985.0, 4000.0, 7000.0, *(777 * np.pi * np.arange(1, 3))]
    for body, start_k in enumerate((300.0, 250.0)):
        state, worst_k = start_k, 0.0
        for begin_s, end_s in itertools.pairwise(sorted(kinks)):
            solved = solve_ivp(
                lambda t, y, body=body: heating(np.array([t]))[body] - bodies.cooling_k3_s * y**4,
                (begin_s, end_s), [state], method="Radau", rtol=1e-11, atol=1e-9, dense_output=True,
            )  # fmt: skip
            time = np.random.default_rng(SEED).uniform(begin_s, end_s, 500)
            rows = TemperatureRows(course.time_s, course.temperature_k[body])
            worst_k = max(worst_k, np.abs(rows.at(time) - solved.sol(time)[0]).max())
            state = solved.y[0, -1]
        assert worst_k < PASS_K + ORACLE_K


@pytest.mark.ci
def test_a_rough_heating_is_said_not_smoothed_over():
    """Noise, other at every call, has no course; nor has a swing that is too fast for the steps allowed."""
    rng = np.random.default_rng(SEED)
    rough = ThermalNodes(lambda time_s: rng.normal(0, 1e4, (1, len(time_s))), 1e-9)
    with pytest.raises(ws.InputError, match="the temperature cannot be integrated"):
        integrate(rough, np.array([300.0]), [0.0, 0.01], 60.0, most_steps=3000)
    fast = ThermalNodes(lambda time_s: 1e4 * np.sin(1e4 * time_s)[None], 1e-9)
    with pytest.raises(ws.InputError, match=r"the temperature cannot be integrated near .* s: it changes too fast"):
        integrate(fast, np.array([300.0]), [0.0, 1e6], 60.0, most_steps=2000)


def test_bodies_that_only_heat_up_are_stopped():
    bodies = ThermalNodes(lambda time_s: np.full((1, len(time_s)), 1e3), 0.0)
    with pytest.raises(ws.InputError, match="the temperature passes 100000 K near"):
        integrate(bodies, np.array([300.0]), [0.0, 1000.0], 60.0)
    course = integrate(bodies, np.array([300.0]), [0.0, 10.0], 60.0)  # linear: as few rows as steps
    np.testing.assert_allclose(course.temperature_k[0], 300.0 + 1e3 * course.time_s, rtol=1e-12)


# Power taken up


def sphere(**fields):
    values = {"capacity_j_k": 1.0, "surface_m2": 4 * np.pi, "solar_absorptance": 1.0, "infrared_emissivity": 1.0,
              "earth_w_m2": 0.0, "albedo": 0.0}  # fmt: skip
    return LumpedNode(**(values | fields))


@pytest.mark.parametrize("distance_au", [0.98, 1.0, 1.02, 2.0])
def test_a_black_sphere_in_the_sun_follows_the_law_of_the_square_root(distance_au):
    place = np.array([0.0, 4e8, 0.0])  # so far that the Earth is a point
    sun = place + np.array([distance_au * AU_M, 0.0, 0.0])
    ball = sphere()
    kelvin = ball.equilibrium_k(ball.absorbed_w(place, sun, np.array([0.0, 0, 1]), np.array(np.pi)))
    assert kelvin == pytest.approx((1361.0 / (4 * SIGMA)) ** 0.25 / np.sqrt(distance_au), rel=1e-12)
    if distance_au == 1.0:
        assert kelvin == pytest.approx(278.3, abs=0.05)  # 278.6 K with the older 1366 W/m2


def test_constants():
    assert pytest.approx(SIGMA, rel=1e-15) == STEFAN_BOLTZMANN_W_M2_K4


@pytest.mark.parametrize("radius_m", [6.3781e6, 6.9e6, 1.2e7, 4.2e7, 4e8])
def test_mean_view_factor_of_a_sphere_is_the_integral(radius_m):
    """Over a sphere's surface, each element's factor by quadrature over the part of the Earth's disc it sees."""
    place = np.array([radius_m, 0.0, 0.0])  # over the equator
    sine = min(6_378_137.0 / radius_m, 1.0)
    rho = np.arcsin(sine)

    def seen(zenith):
        """Integral of max(0, n . l) / pi over the disc, n at an angle from nadir."""

        def ring(angle):
            a, b = np.cos(zenith) * np.cos(angle), np.sin(zenith) * np.sin(angle)
            half = np.pi if a >= b else (0.0 if a <= -b else np.arccos(-a / b))
            return 2 * (a * half + b * np.sin(half)) * np.sin(angle) / np.pi

        kinks = [x for x in (np.pi / 2 - zenith, zenith - np.pi / 2) if 0 < x < rho]
        return quad(ring, 0, rho, points=kinks or None, epsabs=1e-12)[0]

    split = [np.pi / 2 - rho, np.pi / 2 + rho]
    mean = 0.5 * quad(lambda x: seen(x) * np.sin(x), 0, np.pi, points=split, epsabs=1e-9)[0]
    assert mean_view_factor(place, np.array([0.0, 0, 1])) == pytest.approx(mean, rel=1e-6, abs=1e-9)
    assert mean_view_factor(place[::-1], np.array([0.0, 0, 1])) < mean_view_factor(place, np.array([0.0, 0, 1]))


def test_each_term_of_the_power():
    place, sun = np.array([7e6, 0.0, 0.0]), np.array([AU_M * np.cos(1.0), AU_M * np.sin(1.0), 0.0])
    ball = sphere(solar_absorptance=0.3, infrared_emissivity=0.8, earth_w_m2=237.0, albedo=0.25)
    w = (1 - np.sqrt(1 - (6_378_137.0 / 7e6) ** 2)) / 2
    to_sun = sun - place
    distance = np.linalg.norm(to_sun)
    flux = SUN_W_M2 * (AU_M / distance) ** 2
    expected = 0.3 * flux * (2.0 + 0.25 * (to_sun[0] / distance) * 4 * np.pi * w) + 0.8 * 237.0 * 4 * np.pi * w
    pole = np.array([0.0, 0.0, 1.0])
    assert ball.absorbed_w(place, sun, pole, np.array(2.0)) == pytest.approx(expected, rel=1e-13)
    behind = ball.absorbed_w(place, -sun * np.array([1.0, 0.0, 0.0]), pole, np.array(2.0))  # in the umbra
    assert behind == pytest.approx(0.8 * 237.0 * 4 * np.pi * w, rel=1e-13)
    assert ball.absorbed_w(1e-3 * place, sun, pole, np.array(2.0)) == pytest.approx(  # below the ground: half the sky
        0.3 * SUN_W_M2 * (2.0 + 0.25 * np.cos(1.0) * 2 * np.pi) + 0.8 * 237.0 * 2 * np.pi, rel=1e-3
    )


# Areas of turning bodies

SHAPES = {"cylinder": ws.Cylinder(0.25, 1.0), "cone": ws.Cone(0.25, 1.0), "disc": ws.Cylinder(1.0, 0.01)}
MOTIONS = {
    "rest": {},
    "precession": {"precession_rev_s": 1.0, "precession_angle_deg": 20.0},
    "rolling": {"rolling_rev_s": -1.0},
    "both": {"rolling_rev_s": 1.0, "precession_rev_s": 0.7310585786},
    "in-step": {"rolling_rev_s": 1.0, "precession_rev_s": 3.0},
    "slow": {"rolling_rev_s": 0.004, "precession_rev_s": 0.003, "precession_angle_deg": 30.0},
    "slow-and-fast": {"rolling_rev_s": 0.004, "precession_rev_s": 2.0},
}


def motions(fields, n):
    attitude = ws.Attitude(axis="random", **fields)
    return [body_motion(attitude, np.ones(3), 7, body) for body in range(n)]


def directions(*shape):
    return unit_vectors(SEED, *shape)


def area_along(shape, rotation, direction):
    """Area by an angle from the axis that scipy's rotations give."""
    cosine = np.clip(rotation.inv().apply(direction)[..., 2], -1, 1)
    return shape.projected_area_m2(np.arccos(cosine))


def mean_area(shape, body, time_s, direction, span_s):
    """Mean over fast phases, on grids of another kind than the lattice: midpoints, odd numbers."""
    motion = body.attitude
    rates = {"precession": motion.precession_rev_s, "rolling": motion.rolling_rev_s}
    n = {"both": 701}.get(body_kind(rates, span_s), 20_011)
    u = (np.arange(n) + 0.5) / n
    if body_kind(rates, span_s) == "both":
        azimuth, polar = (x.ravel() for x in np.meshgrid(u, u))
    elif body_kind(rates, span_s) == "in-step":
        azimuth = 3 * u + body.precession_phase_rev
        polar = u + body.rolling_phase_rev
    else:
        azimuth, polar = (
            u if abs(rate) * span_s > 100 else rate * time_s + getattr(body, f"{name}_phase_rev") + 0 * u
            for name, rate in rates.items()
        )
    angles = np.stack([2 * np.pi * azimuth, 2 * np.pi * polar + np.radians(motion.precession_angle_deg)], axis=1)
    reference, first, second = body.axes
    frame = Rotation.from_matrix(np.column_stack([first, second, reference]))
    return area_along(shape, frame * Rotation.from_euler("ZY", angles), direction).mean()


def body_kind(rates, span_s):
    fast = [rate for rate in rates.values() if abs(rate) * span_s > 100]
    return "one" if len(fast) < 2 else ("in-step" if rates["precession"] == 3.0 else "both")


@pytest.mark.slow
@pytest.mark.parametrize("shape", SHAPES.values(), ids=SHAPES)
@pytest.mark.parametrize("fields", MOTIONS.values(), ids=MOTIONS)
def test_area_is_the_mean_over_fast_turns_at_the_slow_ones_phase(shape, fields):
    bodies, span_s = motions(fields, 3), 5000.0
    towards, time = directions(3, 2), np.array([0.0, 777.0])
    seen = RotatingArea(shape, bodies, span_s).towards(time, towards)
    for i, j in np.ndindex(3, 2):
        if not any(abs(rate) * span_s > 100 for rate in (value for name, value in fields.items() if "rev" in name)):
            expected = area_along(shape, Rotation.from_quat(bodies[i].at(time[j])), towards[i, j])[0]
            assert seen[i, j] == pytest.approx(expected, rel=1e-9)
            continue
        expected = mean_area(shape, bodies[i], time[j], towards[i, j], span_s)
        rtol = MEAN_RTOL if "rolling_rev_s" in fields and fields.get("precession_rev_s", 3.0) < 1 else PATH_RTOL
        assert seen[i, j] == pytest.approx(expected, rel=rtol)


def test_table_of_the_suns_way_is_the_area_itself():
    """A day of the Sun's way, seen from places far from the Earth's centre."""
    node_s = np.linspace(0, 86_400.0, 14)
    way = np.radians(0.9856 * node_s / 86_400.0)
    node = np.stack([np.cos(way), np.sin(way) * 0.92, np.sin(way) * 0.39], axis=1)
    node /= np.linalg.norm(node, axis=1, keepdims=True)
    bodies = motions(MOTIONS["precession"], 3)
    area = RotatingArea(SHAPES["cylinder"], bodies, 86_400.0)
    assert area.is_steady
    table = steady_area(area, 3, node_s, node)
    time = np.random.default_rng(SEED).uniform(0, 86_400.0, 5)
    way = np.radians(0.9856 * time / 86_400.0)
    seen_from = np.stack([np.cos(way), np.sin(way) * 0.92, np.sin(way) * 0.39], axis=1)
    seen_from = seen_from + 2.8e-4 * directions(3, 5)  # from geostationary orbit
    seen_from /= np.linalg.norm(seen_from, axis=-1, keepdims=True)
    np.testing.assert_allclose(table.towards(time, seen_from), area.towards(time, seen_from), rtol=TABLE_RTOL)


def test_turns_that_keep_step_are_found():
    assert commensurate_turns([1.0, 3.0], 1e4) == [1, 3]
    assert commensurate_turns([5.0, -3.0, 1.25], 1e4) == [20, -12, 5]
    assert commensurate_turns([1.0, 0.7310585786], 1e4) is None
    assert commensurate_turns([1.0, 1.0 + 1e-6], 1e4) == [1, 1]
    assert commensurate_turns([1.0, 1.001], 1e4) is None  # ten turns apart in the end
    assert commensurate_turns([2.5], 1e4) == [1]


class Box:
    """A mesh's way of telling areas: a cuboid's, from closed form."""

    kind = "mesh"

    def projected_area_along_m2(self, view):
        return np.abs(view) @ np.array([2.0, 0.5, 1.0])


@pytest.mark.parametrize(
    "fields",
    [{"spin_rev_s": 3.0}, {"spin_rev_s": 3.0, "precession_rev_s": 1.0, "precession_angle_deg": 25.0},
     {"spin_rev_s": 0.001, "precession_rev_s": 0.002, "precession_angle_deg": 25.0}],
    ids=["spin", "in-step", "slow"],
)  # fmt: skip
def test_spin_counts_for_meshes(fields):
    (body,), towards = motions(fields, 1), directions(1, 1)
    seen = RotatingArea(Box(), [body], 5000.0).towards(np.array([50.0]), towards)[0, 0]
    time = 50.0 + ((np.arange(10_007) + 0.5) / 10_007 if fields["spin_rev_s"] == 3.0 else np.zeros(1))
    in_body = Rotation.from_quat(body.at(time)).inv().apply(towards[0, 0])
    assert seen == pytest.approx(Box().projected_area_along_m2(in_body).mean(), rel=PATH_RTOL)


# Scenes


def low_orbit(scene, temperature, attitude, shape, duration_s=4400.0, count=1, release=None):
    """A target in low orbit, with an eclipse, and some that leave it."""
    data = scene.to_dict()
    body = {"shape": shape, "surface": {"reflectance": {"A": 0.5, "C": 0.4, "E": 0.3}}, "attitude": attitude,
            "temperature": temperature}  # fmt: skip
    group = data["groups"][0]
    group["targets"] = [{"name": "main", **body}, {"name": "piece", "count": count, **body}]
    data |= {"duration_s": duration_s, "epoch_utc": "2025-03-20T12:00:00"}
    group["release"] = release or group["release"]
    group["trajectory"] = {"kind": "elements", "altitude_km": 500.0, "inclination_deg": 30.0}
    data["frames"] = {"count": 3, "interval_s": 10.0}
    return ws.Scene.from_dict(data)


def oracle(scene, name, model, area_of, start_k, begin_s=0.0):
    """Temperature by scipy as a function of time; forces written anew, area_of(time, direction to the Sun)."""
    emissivity = model.infrared_emissivity
    surface = scene.scenario.targets[scene.target_names.index(name)].spec.shape.surface_m2
    pole = scene.scenario.tracks.pole_icrs
    scale_j_k = model.mass_kg * model.heat_capacity_j_kg_k

    def rate(time_s, kelvin):
        t = min(max(time_s, 0.0), scene.duration_s)
        place, sun = scene.position_m(name, t)[0], scene.position_m("sun", t)[0]
        d = sun - place
        far = np.sqrt(d @ d)
        r = np.sqrt(place @ place)
        cap_sr = 2 * np.pi * (1 - np.cos(np.arcsin(ground_m(place / r, pole) / r)))
        flux = SUN_W_M2 / (far / AU_M) ** 2
        lit = scene.scenario.sunlit_fraction(name, t)[0]
        sun_w = flux * lit * area_of(t, d / far)
        albedo_w = model.albedo * flux * max(0.0, place @ d / (r * far)) * surface * cap_sr / (4 * np.pi)
        earth_w = model.earth_w_m2 * surface * cap_sr / (4 * np.pi)
        gain = model.solar_absorptance * (sun_w + albedo_w) + emissivity * earth_w
        return (gain - emissivity * SIGMA * surface * kelvin**4) / scale_j_k

    # Shadow edges are kinks: the oracle takes them from the scene's eclipses, as its step control may pass them.
    table = scene.scenario.eclipses(name)
    kinks = [float(row[column]) for row in table for column in ("start_s", "umbra_start_s", "umbra_end_s", "end_s")]
    stops = [begin_s, *sorted(x for x in kinks if begin_s < x < scene.duration_s), scene.duration_s]
    pieces, state = [], start_k
    for piece in itertools.pairwise(stops):
        solved = solve_ivp(
            lambda t, y: [rate(t, y[0])], piece, [state], method="DOP853", rtol=1e-10, atol=1e-8, dense_output=True,
            max_step=100.0,
        )  # fmt: skip
        pieces.append((piece, solved.sol))
        state = solved.y[0, -1]
    return pieces, len(table)


def worst_difference_k(scene, name, pieces, n=400):
    rng = np.random.default_rng(SEED)
    worst_k = 0.0
    for (begin_s, end_s), solution in pieces:
        time = rng.uniform(begin_s, end_s, n)
        worst_k = max(worst_k, np.abs(scene.scenario.temperature_k(name, time) - solution(time)[0]).max())
    return worst_k


HEAVY = {"mass_kg": 15.0, "heat_capacity_j_kg_k": 900.0}
FOIL = {"mass_kg": 0.1, "heat_capacity_j_kg_k": 900.0}
COEFFICIENTS = {"solar_absorptance": 0.35, "infrared_emissivity": 0.75}
CYLINDER = {"kind": "cylinder", "radius_m": 0.25, "height_m": 1.0}
SPHERE = {"kind": "sphere", "radius_m": 0.5}


REST, ROLLING = {"axis": [0.3, -0.5, 0.8]}, {"rolling_rev_s": 0.0015, "axis": "random"}


@pytest.mark.parametrize(
    ("shape", "attitude", "matter"),
    [
        pytest.param(SPHERE, {}, HEAVY, id="sphere-heavy"),
        slow(SPHERE, {}, FOIL, id="sphere-foil"),
        pytest.param(CYLINDER, REST, HEAVY, id="rest-heavy"),
        slow(CYLINDER, REST, FOIL, id="rest-foil"),
        slow(CYLINDER, ROLLING, HEAVY, id="slow-rolling-heavy"),
        slow(CYLINDER, ROLLING, FOIL, id="slow-rolling-foil"),
    ],
)
def test_scene_against_scipy(scene, matter, shape, attitude, record_accuracy):
    """Two ways through the shadow's edge, a foil that settles in 11 s, a body whose outline swings."""
    model = ws.HeatBalance(290.0, **matter, **COEFFICIENTS)
    orbit = low_orbit(scene, model, attitude, shape)
    body = orbit.targets[0].shape

    def area_of(time_s, to_sun):
        if body.kind == "sphere":
            return np.pi * 0.25
        cosine = float(np.clip(orbit.scenario.body_axis("main", time_s)[0] @ to_sun, -1, 1))
        return np.pi * 0.25**2 * abs(cosine) + 2 * 0.25 * 1.0 * np.sqrt(1 - cosine**2)

    pieces, n_eclipse = oracle(orbit, "main", model, area_of, 290.0)
    assert n_eclipse >= 1
    worst_k = worst_difference_k(orbit, "main", pieces)
    rows = orbit.scenario.temperatures[0]
    assert worst_k < PASS_K + ORACLE_K
    record_accuracy("Temperature by heat balance", worst_k, PASS_K + ORACLE_K, "K", "scipy, forces written anew")
    assert rows.error_k <= PASS_K
    swing_k = np.ptp(rows.temperature_k)
    assert swing_k > (5.0 if matter is HEAVY else 60.0)


@pytest.mark.ci
def test_energy_is_kept(scene):
    """What a body holds changes by what goes in less what goes out, summed by Simpson's rule from the power alone."""
    model = ws.HeatBalance(300.0, **HEAVY, **COEFFICIENTS)
    orbit = low_orbit(scene, model, {}, SPHERE)
    rows = orbit.scenario.temperatures[0]
    ball = LumpedNode(13_500.0, np.pi, 0.35, 0.75, 237.0, 0.3)
    time = np.linspace(0, 4400.0, 44_001)
    outline = np.full(len(time), np.pi / 4)
    power = ball.absorbed_w(
        orbit.position_m("main", time), orbit.position_m("sun", time), orbit.scenario.tracks.pole_icrs, outline
    )
    net = power - 0.75 * SIGMA * np.pi * rows.at(time) ** 4
    gained = (net[0] + net[-1] + 4 * net[1:-1:2].sum() + 2 * net[2:-1:2].sum()) * 0.1 / 3
    assert gained / 13_500.0 == pytest.approx(rows.temperature_k[-1] - rows.temperature_k[0], abs=PASS_K)


def test_eclipse_entry(scene):
    """A foil in full light holds still, and falls by the rate of its own emission once in the umbra."""
    model = ws.HeatBalance("equilibrium", 0.05, 900.0, 0.35, 0.75, earth_w_m2=0.0, albedo=0.0)
    orbit = low_orbit(scene, model, {}, SPHERE)
    first = orbit.scenario.eclipses("main")[0]
    start_s, umbra_s = float(first["start_s"]), float(first["umbra_start_s"])
    assert start_s > 100.0
    before = orbit.scenario.temperature_k("main", np.linspace(0.0, start_s - 1.0, 50))
    far_m = np.linalg.norm(orbit.position_m("sun", [0.0]) - orbit.position_m("main", [0.0]))
    still_k = (0.35 * SUN_W_M2 * (AU_M / far_m) ** 2 / (4 * 0.75 * SIGMA)) ** 0.25
    np.testing.assert_allclose(before, still_k, rtol=0, atol=0.02)  # the distance changes on the way, by 8 mK
    time = np.linspace(umbra_s + 1.0, umbra_s + 600.0, 500)
    begin_k = orbit.scenario.temperature_k("main", time[0])[0]
    k = 0.75 * SIGMA * np.pi / 45.0
    exact = (begin_k**-3 + 3 * k * (time - time[0])) ** (-1 / 3)
    np.testing.assert_allclose(orbit.scenario.temperature_k("main", time), exact, rtol=0, atol=2 * PASS_K)


@pytest.mark.ci
def test_mean_over_fast_turns_is_the_motion_within_the_ripple_told(scene):
    """Rolling 4 rev/s, followed turn by turn by scipy, swings about the mean by no more than `ripple_k` says."""
    model = ws.HeatBalance(290.0, 0.002, 900.0, **COEFFICIENTS)
    rolling = {"rolling_rev_s": 4.0, "axis": "random"}
    orbit = low_orbit(scene, model, rolling, CYLINDER, duration_s=27.0)
    assert len(orbit.scenario.eclipses("main")) == 0

    fine_s = np.linspace(0, 27.0, 27 * 4 * 400 + 1)  # 400 a turn
    place, sun = orbit.position_m("main", fine_s), orbit.position_m("sun", fine_s)
    to_sun = (sun - place) / np.linalg.norm(sun - place, axis=1, keepdims=True)
    cosine = np.clip(np.sum(orbit.scenario.body_axis("main", fine_s) * to_sun, axis=1), -1, 1)
    area = np.pi * 0.25**2 * np.abs(cosine) + 2 * 0.25 * 1.0 * np.sqrt(1 - cosine**2)
    surface = orbit.targets[0].shape.surface_m2
    heated_w = LumpedNode(1.8, surface, 0.35, 0.75, 237.0, 0.3).absorbed_w(
        place, sun, orbit.scenario.tracks.pole_icrs, area
    )
    solved = solve_ivp(
        lambda t, y: (np.interp(t, fine_s, heated_w) - 0.75 * SIGMA * surface * y**4) / 1.8,
        (0, 27.0), [290.0], rtol=1e-8, atol=1e-8, max_step=0.02, dense_output=True,
    )  # fmt: skip
    time = np.linspace(5.0, 26.9, 2000)
    rows = orbit.scenario.temperatures[0]
    swing_k = np.abs(rows.at(time) - solved.sol(time)[0]).max()
    assert 0.05 < 0.2 * rows.ripple_k < swing_k < rows.ripple_k
    balls = low_orbit(scene, model, rolling, SPHERE, duration_s=27.0)
    assert balls.scenario.temperatures[0].ripple_k == 0.0


def test_targets_of_a_group_have_courses_of_their_own(scene):
    """Spheres that fly together are alike within what their places differ by; rolling cylinders are not."""
    model = ws.HeatBalance(290.0, **FOIL, **COEFFICIENTS)
    balls = low_orbit(scene, model, {"rolling_rev_s": 1.0, "axis": "random"}, SPHERE, count=6, duration_s=1500.0)
    tubes = low_orbit(scene, model, {"rolling_rev_s": 1.0, "axis": "random"}, CYLINDER, count=6, duration_s=1500.0)
    time = np.linspace(0, 1500.0, 50)
    spread_k = [
        np.ptp([one.scenario.temperature_k(name, time) for name in one.target_names[1:]], axis=0).max()
        for one in (balls, tubes)
    ]
    assert spread_k[0] < 0.5  # eight kilometres: a second at the shadow's edge
    assert spread_k[1] > 5.0
    alone = low_orbit(scene, model, {"rolling_rev_s": 1.0, "axis": "random"}, CYLINDER, count=1, duration_s=1500.0)
    seen = tubes.scenario.temperature_k("piece01", time) - alone.scenario.temperature_k("piece", time)
    assert np.abs(seen).max() < 2 * PASS_K  # whoever goes beside it


@pytest.mark.ci
def test_later_releases_hold_their_temperature_until_then(scene):
    model = ws.HeatBalance(333.0, **FOIL, **COEFFICIENTS)
    late = low_orbit(scene, model, {}, SPHERE, release={"time_s": 600.0, "speed_m_s": [1.0, 2.0]}, duration_s=1500.0)
    np.testing.assert_array_equal(late.scenario.temperature_k("piece", [0.0, 300.0, 599.9]), 333.0)
    assert abs(late.scenario.temperature_k("piece", 610.0)[0] - 333.0) > 1.0
    pieces, _ = oracle(late, "piece", model, lambda t, d: np.pi * 0.25, 333.0, begin_s=600.0)
    assert worst_difference_k(late, "piece", pieces) < PASS_K + ORACLE_K


def test_coefficients_left_out_are_the_mean_emissivity(scene):
    bare = low_orbit(scene, ws.HeatBalance(290.0, **FOIL), {}, SPHERE, duration_s=900.0)
    given = low_orbit(scene, ws.HeatBalance(290.0, **FOIL, solar_absorptance=0.6, infrared_emissivity=0.6), {}, SPHERE,
                      duration_s=900.0)  # fmt: skip
    time = np.linspace(0, 900.0, 30)
    kelvin = [one.scenario.temperature_k("main", time) for one in (bare, given)]
    np.testing.assert_allclose(*kelvin, rtol=0, atol=1e-9)


@pytest.mark.ci
def test_attitude_tables_are_followed(scene):
    """A body that turns by a table is as warm as one that turns so by itself."""
    model = ws.HeatBalance(290.0, **FOIL, **COEFFICIENTS)
    slow = {"rolling_rev_s": 0.002, "axis": [0.0, 0.6, 0.8], "rolling_phase_rev": 0.1, "spin_phase_rev": 0.0,
            "precession_phase_rev": 0.3}  # fmt: skip
    moving = low_orbit(scene, model, slow, CYLINDER, duration_s=2000.0)
    time = np.linspace(0.0, 2000.0, 101)
    table = ws.AttitudeTable(time_s=time, quaternion=moving.scenario.attitude_quaternion("main", time))
    tabled = low_orbit(scene, model, table, CYLINDER, duration_s=2000.0)
    difference = tabled.scenario.temperature_k("main", time) - moving.scenario.temperature_k("main", time)
    assert np.abs(difference).max() < 2 * PASS_K


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"mass_kg": -1.0}, "mass_kg: must be > 0, got -1"),
        ({"mass_kg": 0.0}, "mass_kg: must be > 0, got 0"),
        ({"mass_kg": float("nan")}, "mass_kg: must be finite"),
        ({"heat_capacity_j_kg_k": 0}, "heat_capacity_j_kg_k: must be > 0"),
        ({"solar_absorptance": 1.01}, r"solar_absorptance: must be in \[0, 1\], got 1.01"),
        ({"infrared_emissivity": -0.1}, "infrared_emissivity: must be >= 0"),
        ({"albedo": 1.5}, r"albedo: must be in \[0, 1\]"),
        ({"earth_w_m2": -1}, "earth_w_m2: must be >= 0"),
        ({"start_k": 0}, r"start_k: must be in \(0, 100000\], got 0"),
        ({"start_k": "cold"}, "start_k: must be a temperature or 'equilibrium', got 'cold'"),
        ({"end_k": 3.0}, "end_k: is not a known field"),
    ],
)
def test_bad_balances_are_refused_in_one_line(fields, message):
    with refused_in_one_line(message):
        ws.HeatBalance(**({"start_k": 300.0, "mass_kg": 1.0, "heat_capacity_j_kg_k": 900.0} | fields))


def test_units_of_quantities_are_honoured():
    import astropy.units as u

    model = ws.HeatBalance(0.3 * u.kK, 500 * u.g, 0.9 * u.J / u.g / u.K)
    assert (model.start_k, model.mass_kg, model.heat_capacity_j_kg_k) == pytest.approx((300.0, 0.5, 900.0))


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"infrared_emissivity": 0.0}, "start_k: must be a temperature where infrared_emissivity is 0"),
        ({"solar_absorptance": 0.0, "earth_w_m2": 0.0}, "start_k: must be a temperature where nothing is absorbed"),
    ],
)
def test_no_equilibrium_is_said(scene, fields, message):
    model = ws.HeatBalance("equilibrium", 1.0, 900.0, **(COEFFICIENTS | fields))
    orbit = low_orbit(scene, model, {}, SPHERE, duration_s=900.0)
    with refused_in_one_line(r"targets\[0\]\.temperature\." + message):
        orbit.scenario.temperature_k("main", 0.0)
