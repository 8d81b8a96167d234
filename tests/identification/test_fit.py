"""Identification: round trips, what data determine, intervals, bounds, and the shipped data."""

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest
from scipy import stats
from scipy.optimize import curve_fit
from synthetic_curves import synthesise

from fabric_fenicsx.core.errors import InputError
from fabric_fenicsx.identification import curves as data
from fabric_fenicsx.identification import identify
from fabric_fenicsx.identification.curves import Curve, Response, Sheet
from fabric_fenicsx.identification.curves.model import response as predicted
from fabric_fenicsx.identification.problem import true_values
from fabric_fenicsx.material.homogeneous import nominal
from fabric_fenicsx.material.presets import PRESETS
from fabric_fenicsx.studies.lib.identified import draw

KOMEILI = PRESETS["komeili"]
SHEET = Sheet("x", 1.0, 0.75, True)
SHIPPED = Path(__file__).parents[2] / "studies" / "data"
# Where fits start in round trips, as the defaults are the truth for Table 1.
FAR = {"a": 900.0, "b": 150.0, "c": 6.0, "s_T": 100.0, "s1": 1.0, "s2": 0.5, "s3": 1.0}
FAR_ALL = FAR | {"d": 5.0, "p_min": 0.3, "s_C": 10.0}


def curve(test, x, column, y, abscissa, noise=None, **keys):
    strains = np.zeros((len(x), 3))
    strains[:, abscissa] = x
    response = predicted(column, np.asarray(y, float), strains[:, 2], test, keys, 1.0)
    rows = strains, (response,), np.arange(len(x))
    return Curve(f"{test}.csv", test, *rows, abscissa, None, noise, keys)


def shear(g, tau, noise=None):
    return curve("shear", g, "tau", tau, 2, noise)


def only(curves, *names):
    return [c for c in curves if c.file.removesuffix(".csv") in names]


def worst(result, truth):
    return max(abs(p.value / truth[n] - 1) for n, p in result.determined.items())


def test_round_trip_of_17_parameters(unbalanced):
    sheet, curves = synthesise(unbalanced, "all")
    result = identify(dataclasses.replace(sheet, assumed=FAR_ALL), curves)
    assert len(result.determined) == 17 and not result.assumed
    assert worst(result, true_values(unbalanced, False)) < 1e-6
    assert (result.fabric.weft.a, result.fabric.thickness) == (pytest.approx(2100.0), 0.8)


@pytest.mark.parametrize(
    ("names", "determined"),
    [
        (["uniaxial_a"], "a b"),
        (["shear"], "s1 s2 s3"),
        (["biaxial_1_1", "biaxial_2_1"], "a b c"),  # tension-tension: not p_min
        (["uniaxial_a", "tension_compression_a"], "a b d p_min c"),
        (["free_a"], "a b d p_min c"),  # the contraction shows d
        (["shear", "shear_tension_b"], "s_T s1 s2 s3"),
        (["shear", "shear_compression_b"], "s_C s1 s2 s3"),
    ],
)
def test_what_tests_determine(names, determined):
    sheet, curves = synthesise(KOMEILI)
    far = FAR if "biaxial_1_1" in names else FAR_ALL
    result = identify(dataclasses.replace(sheet, assumed=far), only(curves, *names))
    assert " ".join(result.determined) == determined
    assert len(result.assumed) + len(result.determined) == 10
    assert worst(result, true_values(KOMEILI, True)) < 1e-6


def test_what_the_data_cannot_separate_is_assumed():
    """A narrow range of angles shows no curvature; held tension with one strain across no c."""
    g = np.linspace(0.5, 0.6, 8)
    result = identify(SHEET, [shear(g, 0.3 * g)])
    assert "data determine it only to" in result.assumed["s3"].reason
    assert result.fabric.s3 == 0
    assert result.assumed["s3"].source.startswith("0, as the lower term")
    sheet, curves = synthesise(KOMEILI, points=8)
    pull = only(curves, "tension_compression_a")[0]
    strains = np.stack([np.linspace(0.01, 0.03, 8), np.full(8, -0.03), np.zeros(8)], -1)
    response = Response("sigma_a", "MPa", nominal(KOMEILI, strains)[:, 0], np.ones(8))
    changed = dataclasses.replace(pull, strains=strains, responses=(response,), abscissa=0)
    result = identify(sheet, [changed])
    assert {"p_min", "c"} <= {*result.assumed} and {"a", "b"} <= {*result.determined}


def pulled(noise, truth=(4130.0, 667.5), size=0.0, seed=4):
    """Held tension, which is linear in a and b: curve, matrix and values; its peak not the last."""
    x = np.linspace(0.0005, 0.03, 15)[[*range(1, 15, 2), 14, *range(0, 13, 2)][:15]]
    X = np.stack([3 * x**2, 2 * x], -1)
    y = X @ truth + np.random.default_rng(seed).normal(0, size, 15)
    return curve("uniaxial_a", x, "sigma_a", y, 0, noise), X, y


def test_intervals_of_a_linear_fit():
    """The textbook's, of curves with each kind of noise and of one that states none."""
    noises = ("absolute", 0.4), ("maximum", 0.02), ("value", 0.03), None
    sizes = 0.6, 0.9, 0.5, 2.0
    tests = [pulled(each, size=size, seed=k) for k, (each, size) in enumerate(zip(noises, sizes))]
    curves, parts, values = zip(*tests)
    X, y, known = np.concatenate(parts), np.concatenate(values), values[2]
    estimated = 0.01 * values[3].max()
    for _ in range(4):
        by_value = 0.03 * np.maximum(known, 0.05 * values[2].max())
        sd = [np.full(15, 0.4), np.full(15, 0.02 * values[1].max()), by_value]
        sd = np.concatenate([*sd, np.full(15, estimated)])
        solution, rss, *_ = np.linalg.lstsq(X / sd[:, None], y / sd, rcond=None)
        known = parts[2] @ solution
        estimated = np.sqrt(np.mean((parts[3] @ solution - values[3]) ** 2))
    sd[30:45] = 0.03 * np.maximum(known, 0.05 * values[2].max())
    sd[45:] = estimated
    off = (X @ solution - y) / sd
    A = X / sd[:, None]
    covariance = np.linalg.inv(A.T @ A) * (off @ off) / 58
    result = identify(SHEET, curves)
    for k, name in enumerate("ab"):
        found, error = result.determined[name], math.sqrt(covariance[k, k])
        half = stats.t.ppf(0.975, 58) * error
        assert (found.value, found.standard_error) == pytest.approx((solution[k], error), rel=1e-5)
        assert found.interval == pytest.approx((solution[k] - half, solution[k] + half), rel=1e-5)
    correlation = covariance[0, 1] / math.sqrt(covariance[0, 0] * covariance[1, 1])
    assert result.correlation[0, 1] == pytest.approx(correlation, rel=1e-5)
    assert (result.degrees_of_freedom, result.variance) == (58, pytest.approx(off @ off / 58))
    assert result.noise_estimated == pytest.approx(estimated / values[3].max(), rel=1e-5)
    for told, X, y in zip(result.report()["curves"], parts, values):
        rms = math.sqrt(np.mean((X @ solution - y) ** 2))
        assert (told["rms_error"], told["rms_error_of_peak"]) == pytest.approx((rms, rms / y.max()))


@pytest.mark.parametrize("times", [0.97, 1.03])
def test_limits_of_what_a_fit_tells(times):
    """Just below and above: residuals of any size, across what a and b can follow."""
    one, X, _ = pulled(None)
    r = np.random.default_rng(0).normal(size=15)
    r -= X @ np.linalg.lstsq(X, r, rcond=None)[0]
    a, b = 300.0, 667.5
    error = np.sqrt(np.linalg.inv(X.T @ X)[0, 0] * (r @ r) / 13)  # of a

    def fit(size, noise=None):
        y = X @ [a, b] + size * r
        response = dataclasses.replace(one.responses[0], values=y)
        return identify(SHEET, [dataclasses.replace(one, responses=(response,), noise=noise)])

    above = times > 1
    size = times * a / (stats.t.ppf(0.975, 13) * error)
    weak, noise = fit(size), size * math.sqrt(r @ r / 13) / abs(X @ [a, b] + size * r).max()
    assert weak.noise_estimated == pytest.approx(noise)
    assert weak.determined["a"].value == pytest.approx(a) and weak.determined["a"].weak == above
    # half the interval is the change that moves the response by its peak
    size = 0.0
    for _ in range(20):
        peak = abs(X @ [a, b] + size * r).max()
        size = times * peak / X[:, 0].max() / (1.96 * error)
    lost = fit(size)
    assert ("a" in lost.assumed) == above
    noise = math.sqrt(r @ r / stats.chi2.ppf(0.999, 13)) / times
    doubted = fit(1.0, ("absolute", noise)).warnings
    assert any("times their stated noise" in each for each in doubted) == above


def test_intervals_are_those_of_another_program():
    """SciPy's curve_fit; upwards that of c is as wide in its logarithm."""
    names = "a", "b", "c", "s_T", "s1", "s2", "s3"
    sheet, curves = synthesise(KOMEILI, "paper", 0.02)
    result = identify(sheet, curves)
    assert tuple(result.determined) == names and result.convex_in_tension
    s1, s2, s3 = (result.determined[name].value for name in names[4:])
    assert result.shear_stiffness_min == pytest.approx(s1 - s2**2 / (3 * s3), rel=1e-5)
    places = {"sigma_a": 0, "sigma_b": 1, "tau": 2}
    columns = [(c, r, places[r.column]) for c in curves for r in c.responses]
    y = np.concatenate([r.values for _, r, _ in columns])
    sd = np.concatenate([np.full(30, 0.02 * abs(r.values).max()) for _, r, _ in columns])

    def law(_, *numbers):
        fabric = KOMEILI.replace(**dict(zip(names, numbers)))
        return np.concatenate([nominal(fabric, c.strains)[:, k] for c, _, k in columns])

    start = [true_values(KOMEILI, True)[name] for name in names]
    best, covariance = curve_fit(law, None, y, start, sd, xtol=1e-12, ftol=1e-12)
    error = np.sqrt(np.diag(covariance))
    half = stats.t.ppf(0.975, len(y) - 7) * error
    ends = np.array([best - half, best + half])
    ends[1, 2] = best[2] * math.exp(half[2] / best[2])
    found = result.determined.values()
    assert [p.value for p in found] == pytest.approx(best, rel=1e-4)
    assert [p.standard_error for p in found] == pytest.approx(error, rel=1e-3)
    assert np.transpose([p.interval for p in found]) == pytest.approx(ends, rel=1e-3)
    assert result.correlation == pytest.approx(covariance / np.outer(error, error), abs=1e-3)


def test_shear_stiffness_stays_positive():
    g = np.linspace(0.02, 0.8, 20)
    result = identify(SHEET, [shear(g, (0.3 - g + 0.9 * g**2) * g)])
    assert 0 < result.shear_stiffness_min < 1e-3
    assert all(p.at_bound for p in result.determined.values())
    assert any(w.startswith("s1, s2, s3 are at a physical bound") for w in result.warnings)
    concave = identify(SHEET, [shear(g, 0.2 * g - 0.02 * g**2 - 0.06 * g**3)])
    assert concave.fabric.s3 == 0 and concave.shear_stiffness_min > 0


def test_tension_stays_convex():
    x = np.linspace(0.001, 0.03, 20)
    result = identify(SHEET, [curve("uniaxial_a", x, "sigma_a", 600 * x - 4000 * x**2, 0)])
    assert result.fabric.warp.a == pytest.approx(0, abs=1e-3)
    assert result.fabric.warp.b > 0
    assert result.determined["a"].at_bound
    assert any(w.startswith("a is at a physical bound") for w in result.warnings)
    sheet, curves = synthesise(KOMEILI.replace(p_min=0.1, c=60.0), "paper")
    unstable = identify(dataclasses.replace(sheet, assumed={"p_min": 0.1}), curves)
    assert unstable.convex_in_tension is False and any("not convex" in w for w in unstable.warnings)


def test_errors():
    with pytest.raises(InputError, match="there is no curve"):
        identify(SHEET, [])
    g = np.array([0.1, 0.2, 0.3])
    with pytest.raises(InputError, match="there are 3 measured values for 3 parameters"):
        identify(SHEET, [shear(g, g)])
    with pytest.raises(InputError, match="of the tests shear, determine no parameter; expected"):
        identify(SHEET, [shear(0 * g, g)])
    sheet, curves = synthesise(KOMEILI, balanced=False)
    with pytest.raises(InputError, match="is false, but no test determines the weft's a and b; "):
        identify(sheet, only(curves, "uniaxial_a", "shear"))
    assert identify(sheet, only(curves, "shear")).fabric.is_balanced  # nothing is said to differ


@pytest.mark.versions
@pytest.mark.parametrize(("size", "off"), [("115x230", 0.11), ("150x450", 0.23)])
def test_shipped_measured_data(tmp_path, size, off):
    result = identify(*data.read(SHIPPED / f"glass_pp_{size}"))
    assert list(result.determined) == ["s1", "s2", "s3"] and len(result.assumed) == 7
    assert result.shear_stiffness_min > 0
    (measured,) = result.report()["curves"]
    assert 0.8 * off < measured["rms_error"] < off  # N
    g = np.radians([10, 20, 30, 40])
    F_sh = (result.fabric.s1 + result.fabric.s2 * g + result.fabric.s3 * g**2) * g * 1.2 / np.cos(g)
    # Eq. 18 of Cao et al. by hand, of their raw curves
    by_hand = {
        "115x230": [0.0054, 0.0091, 0.0134, 0.0217],
        "150x450": [0.0064, 0.0092, 0.0143, 0.0244],
    }
    assert F_sh == pytest.approx(by_hand[size], rel=0.1)
    drawn = [Path(p).stem for p in draw(result, tmp_path / "x")]
    assert drawn == ["x_fit", "x_residuals", "x_correlation"]


def strip(curve):
    """A test with free sides of which the width was not measured."""
    return dataclasses.replace(curve, responses=curve.responses[:1])


@pytest.mark.parametrize("p_min, noise", [(0.3, 0.02), (0.75, 0.0)])
def test_strips_with_free_sides_and_no_width_are_taken_as_uncoupled(p_min, noise):
    """So a held strip comes out as stiff as the free one was: never stiffer than the fabric's."""
    fabric = KOMEILI.replace(p_min=p_min)
    _, curves = synthesise(fabric, "all", noise)
    given = [strip(c) for c in only(curves, "free_a", "free_b")]
    result = identify(SHEET, given)
    assert result.assumed["p_min"].value == 1.0
    assert result.assumed["p_min"].source == "no coupling, so that held strips are not too stiff"
    assert any("p_min is set to 1, because strips were" in each for each in result.warnings)
    stretched = np.outer(np.linspace(0.003, 0.03, 10), [1.0, 0.0, 0.0])
    held, true = (nominal(f, stretched)[:, 0] for f in (result.fabric, fabric))
    assert np.all(held < (1.02 + noise) * true)
    assert held[-1] == pytest.approx(given[0].responses[0].values[-1], rel=0.02 + 2 * noise)


def test_intervals_hold_where_coupling_is_weak(p_min=0.95, seed=4):
    """At p_min = 1 and d = 0 only their ratio counts: 0.999 to 1 was the interval there."""
    _, curves = synthesise(KOMEILI.replace(p_min=p_min), "all", 0.03, seed)
    result = identify(SHEET, only(curves, "free_a", "free_b"))
    for name, true in {"a": KOMEILI.warp.a, "b": KOMEILI.warp.b, "p_min": p_min}.items():
        low, high = result.determined[name].interval
        assert low <= true <= high, name


def test_strips_with_free_sides_tell_the_rest_if_p_min_is_known():
    """c, too, but not d, of whose root it depends."""
    _, curves = synthesise(KOMEILI, "all", 0.0)
    known = dataclasses.replace(SHEET, assumed={"p_min": 0.75})
    exact = identify(known, [strip(c) for c in only(curves, "free_a", "free_b")])
    assert list(exact.determined) == ["a", "b", "c"] and not exact.warnings
    assert worst(exact, true_values(KOMEILI, True)) < 1e-6
    assert exact.assumed["d"].reason == "the data cannot distinguish it from others"
    assert exact.assumed["d"].moves == {"c": pytest.approx(0.5 * 2.367, rel=1e-3)}


def test_a_coupling_that_is_complete_at_a_tenth_of_the_strain_across():
    """Its rate c may be up to 50 over the largest strain, which is 0.06."""
    sheet, curves = synthesise(KOMEILI.replace(c=400.0))
    known = dataclasses.replace(sheet, assumed=FAR_ALL | {"c": 100.0})
    result = identify(known, only(curves, "uniaxial_a", "tension_compression_a"))
    assert result.determined["c"].value == pytest.approx(400, rel=1e-3)
