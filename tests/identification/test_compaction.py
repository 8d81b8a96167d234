"""Compaction from tests across the thickness: round trips, what the data tell, what is refused."""

import dataclasses
import math

import numpy as np
import pytest
from curve_texts import FREE, SHEET, UNIAXIAL, folder
from scipy import stats
from scipy.optimize import curve_fit
from scipy.special import lambertw
from synthetic_curves import synthesise, synthesise_compaction

import fabric_fenicsx as ff
from fabric_fenicsx.core.errors import InputError
from fabric_fenicsx.identification import curves as data
from fabric_fenicsx.identification import fit_compaction, identify
from fabric_fenicsx.identification.curves import Sheet
from fabric_fenicsx.studies.lib.identified import draw

PLY = Sheet("x", 0.4, 0.75, True)
SOFT = ff.Compaction(9.0, onset=5e-3, pressure=2e-3)
STIFF = ff.Compaction(25.0, onset=2e-3, pressure=1e-2)


def pressed_sheet(known, *noise, sheet=PLY, points=30):
    """The sheet with a synthetic test for each (noise, seed)."""
    noise = noise or [(0.0, 1)]
    tests = tuple(synthesise_compaction(sheet, known, *each, points) for each in noise)
    return dataclasses.replace(sheet, compaction=tests)


def text_of(p, values, column="thickness [mm]", unit="MPa", head=""):
    rows = "".join(f"{a:.12g},{b:.12g}\n" for a, b in zip(p, values))
    return f"# test: compaction\n{head}pressure [{unit}],{column}\n{rows}"


@pytest.mark.versions
@pytest.mark.parametrize("known", [SOFT, STIFF])
def test_round_trip(known):
    found = fit_compaction(pressed_sheet(known, points=4))
    assert list(found.determined) == ["exponent", "onset", "pressure"] and not found.assumed
    for name, p in found.determined.items():
        assert p.value == pytest.approx(getattr(known, name), rel=1e-6)
        assert p.interval == pytest.approx((p.value, p.value), rel=1e-5)
    assert not found.warnings and found.scatter < 1e-9


def log_thickness(p, *logarithms):
    """Logarithm of the thickness of plies by n, p_0 and p_h: n ln(h_h / h) = y(p) - y(p_h), where
    p / p_0 = e^y - 1 - y; its inverse by Lambert's function."""
    n, onset, pressure = np.exp(logarithms)
    q = np.append(pressure, p) / onset
    y = -(1 + q) - lambertw(-np.exp(-(1 + q)), -1).real
    return math.log(0.4) + (y[0] - y[1:]) / n


@pytest.mark.parametrize("stated", [True, False])
def test_intervals_are_those_of_another_program(stated):
    """SciPy's curve_fit; each kind of noise counts as a share of the thickness."""
    noises = ("maximum", 0.01), ("absolute", 0.003), ("value", 0.005)
    sheet = pressed_sheet(SOFT, (0.008, 1), (0.01, 2), (0.004, 3))
    pairs = [*zip(sheet.compaction, noises if stated else [None] * 3)]
    tests = tuple(dataclasses.replace(test, noise=noise) for test, noise in pairs)
    found = fit_compaction(dataclasses.replace(sheet, compaction=tests))
    thickness = [test.response.values for test in tests]
    h, first = np.concatenate(thickness), thickness[0]
    pressed = np.concatenate([test.pressure for test in tests])
    sd = np.concatenate([0.01 * first.max() / first, 0.003 / thickness[1], 0.005 + 0 * first])
    start = np.log([9, 5e-3, 2e-3])
    sigma = sd if stated else None
    best, covariance = curve_fit(log_thickness, pressed, np.log(h), start, sigma)
    off = log_thickness(pressed, *best) - np.log(h)
    for p, x, error in zip(found.determined.values(), best, np.sqrt(np.diag(covariance))):
        half = stats.t.ppf(0.975, 87) * error
        found_p = p.value, p.standard_error, *p.interval
        wanted = *np.exp(x) * np.array([1, error]), *np.exp([x - half, x + half])
        assert found_p == pytest.approx(wanted, rel=1e-3)
    assert found.scatter == pytest.approx(math.sqrt(off @ off / 87), rel=1e-4)
    told = found.report()["tests"][0]["rms_error_mm"]
    error = np.exp(off[:30] + np.log(first)) - first
    assert told == pytest.approx(math.sqrt(np.mean(error**2)), rel=1e-3)


@pytest.mark.parametrize(
    "lowest, onset, source", [(0.02, 1e-3, "default"), (5e-4, 5e-4, "lowest measured pressure")]
)
def test_an_onset_that_the_data_do_not_tell_is_assumed(lowest, onset, source):
    """Far above the onset, thickness is a power of pressure alone. The intervals of the others are
    those of a fit of all three, of which the onset is at its bound."""
    p = lowest * np.geomspace(1, 50, 20)
    noise = 0.003 * np.random.default_rng(1).normal(size=20)
    h = 0.4 * (2.5 * lowest / p) ** (1 / 12) * (1 + noise)
    test = pressed_sheet(SOFT).compaction[0]
    response = dataclasses.replace(test.response, values=h, gain=np.ones(20))
    test = dataclasses.replace(test, pressure=p, response=response)
    found = fit_compaction(dataclasses.replace(PLY, compaction=(test,)))
    assumed = found.assumed["onset"]
    assert (assumed.value, assumed.source) == (onset, source)
    assert "the data do not determine it" in assumed.reason
    assert source != "default" or found.compaction.exponent == pytest.approx(12.0, rel=0.1)
    (slope, _), covariance = np.polyfit(np.log(p), np.log(h), 1, cov=True)
    alone = stats.t.ppf(0.975, 18) * math.sqrt(covariance[0, 0]) / -slope
    low, high = found.determined["exponent"].interval
    assert math.log(high / low) > 2 * 1.5 * alone


def test_a_data_set_gives_the_fabric_its_compaction(tmp_path):
    known = ff.load("komeili").replace(compaction=SOFT, fibre_density=2.54)
    sheet, curves = synthesise(known, "all", 0.005)
    assert len(sheet.compaction) == 1 and sheet.fibre_density == 2.54
    result = identify(sheet, curves[:1])
    assert result.fabric.fibre_density == 2.54
    assert result.fabric.compaction.exponent == pytest.approx(9.0, rel=0.1)
    assert result.report()["compaction"]["determined"]["onset"]["unit"] == "MPa"
    result.fabric.to_toml(tmp_path / "x.toml", result.remarks())
    assert ff.load(tmp_path / "x.toml") == result.fabric
    assert f"{tmp_path / 'x'}_compaction.png" in draw(result, tmp_path / "x")


def test_fibre_volume_fractions(tmp_path):
    """Of 300 g/m2 of fibres of 2.5 g/cm3, 0.12 mm without pores."""
    known = pressed_sheet(SOFT).compaction[0]
    share = 100 * 0.12 / known.response.values
    text = text_of(10 * known.pressure, share, "fibre_volume_fraction [%]", "bar")
    sheet = "thickness_mm = 0.4\nareal_weight_g_per_m2 = 300\nbalanced = true\n"
    told = f"{sheet}fibre_density_g_per_cm3 = 2.5\n"
    read, _ = data.read(folder(tmp_path, told, pull=FREE, pressed=text))
    assert read.measured_thickness(read.compaction[0]) == pytest.approx(known.response.values)
    assert fit_compaction(read).compaction.exponent == pytest.approx(9.0, rel=1e-6)
    read, _ = data.read(folder(tmp_path, f"{told}fibre_share = 0.5\n", pull=FREE, pressed=text))
    half = known.response.values / 2
    assert read.measured_thickness(read.compaction[0]) == pytest.approx(half)
    folder(tmp_path, sheet, pressed=text)
    with pytest.raises(InputError, match=r"pressed.csv: the column fibre_volume_fraction needs"):
        data.read(tmp_path)


P = [1e-3, 1e-2, 1e-1, 1.0]
H = [0.4, 0.36, 0.32, 0.28]


def test_of_a_loop_the_loading_is_read(tmp_path):
    """And rows that fall or a ply that grows are refused."""
    sheet = SHEET.replace("1.2", "0.4")

    def read(p, h):
        folder(tmp_path, sheet, pull=UNIAXIAL, pressed=text_of(p, h))
        return data.read(tmp_path)[0].compaction[0]

    test = read([*P, 0.1, 0.001], [*H, 0.25, 0.35])
    assert test.pressure.tolist() == P
    assert "pressure reverses after row 6" in test.remarks[0]
    for p, h, words in (
        (P[::-1], H, "row 6: pressure is 0.001 MPa at last; expected to rise"),
        (P, H[::-1], "thickness is 0.4 mm under the highest pressure and 0.28 mm under"),
    ):
        with pytest.raises(InputError, match=f"pressed.csv.*{words}"):
            read(p, h)


def test_what_does_not_tell_the_exponent_is_refused():
    """And plies of another thickness, as of a stack of five."""
    with pytest.raises(InputError, match="determine the exponent only to .*; expected tests of"):
        fit_compaction(pressed_sheet(STIFF, (0.1, 3), points=6))
    sheet = dataclasses.replace(pressed_sheet(SOFT), thickness=0.08)
    with pytest.raises(InputError, match=r"thickness is 0.08 mm, and plies of .* have 0.4"):
        fit_compaction(sheet)


@pytest.mark.parametrize("pressure, told", [(1.05, 0), (1.15, 1), (4.8e-4, 0), (4.3e-4, 1)])
def test_a_sheet_as_thick_as_beyond_the_measured_pressures_is_told(pressure, told):
    """By 10 % of 0.5 kPa or 1 MPa."""
    found = fit_compaction(pressed_sheet(ff.Compaction(9.0, onset=5e-3, pressure=pressure)))
    assert found.compaction.pressure == pytest.approx(pressure, rel=1e-4)
    assert sum("they measured from" in each for each in found.warnings) == told
