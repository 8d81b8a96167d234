"""Compaction from tests across the thickness: round trips, what the data tell, what is refused."""

import dataclasses

import numpy as np
import pytest
from curve_texts import FREE, SHEET, UNIAXIAL, folder
from synthetic_curves import synthesise, synthesise_compaction

import fabric_fenicsx as ff
from fabric_fenicsx.identification import curves as data
from fabric_fenicsx.identification import draw, fit_compaction, identify
from fabric_fenicsx.identification.curves import Sheet
from fabric_fenicsx.runtime.errors import InputError

PLY = Sheet("x", 0.4, 0.75, True)
SOFT = ff.Compaction(9.0, onset=5e-3, pressure=2e-3)
KNOWN = [ff.Compaction(), SOFT, ff.Compaction(25.0, onset=2e-3, pressure=1e-2)]


def pressed_sheet(known, *noise, sheet=PLY, points=30):
    """The sheet with a synthetic test for each (noise, seed)."""
    noise = noise or [(0.0, 1)]
    tests = tuple(synthesise_compaction(sheet, known, *each, points) for each in noise)
    return dataclasses.replace(sheet, compaction=tests)


def text_of(p, values, column="thickness [mm]", unit="MPa", head=""):
    rows = "".join(f"{a:.12g},{b:.12g}\n" for a, b in zip(p, values))
    return f"# test: compaction\n{head}pressure [{unit}],{column}\n{rows}"


@pytest.mark.versions
@pytest.mark.parametrize("known", KNOWN)
def test_round_trip(known):
    found = fit_compaction(pressed_sheet(known, points=4))
    assert list(found.determined) == ["exponent", "onset", "pressure"] and not found.assumed
    for name, p in found.determined.items():
        assert p.value == pytest.approx(getattr(known, name), rel=1e-6)
        assert p.interval == pytest.approx((p.value, p.value), rel=1e-5)
    assert not found.warnings and found.scatter < 1e-9


def test_how_often_the_intervals_hold():
    """40 seeds at 1 %: a 95 % interval holds in 33 or more but about once in 500 times."""
    inside, scatter = dict.fromkeys(("exponent", "onset", "pressure"), 0), []
    for seed in range(40):
        found = fit_compaction(pressed_sheet(SOFT, (0.01, seed)))
        scatter.append(found.scatter)
        for name, p in found.determined.items():
            inside[name] += p.interval[0] <= getattr(SOFT, name) <= p.interval[1]
    assert min(inside.values()) >= 33
    (_, _, thickness) = found.tests[0]  # noise is a share of the largest
    relative = 0.01 * np.sqrt(np.mean((thickness.max() / thickness) ** 2))
    assert np.mean(scatter) == pytest.approx(relative, rel=0.05)


def test_more_certain_tests_count_more():
    """Of two that differ, the one of 0.1 % noise decides over the one of 5 %."""
    rough, fine = (pressed_sheet(k, (0.001, 1)).compaction[0] for k in (SOFT, KNOWN[0]))
    rough = dataclasses.replace(rough, noise=("value", 0.05))
    for stated in (("maximum", 0.001), ("absolute", 0.0004)):
        tests = rough, dataclasses.replace(fine, noise=stated)
        found = fit_compaction(dataclasses.replace(PLY, compaction=tests))
        assert found.compaction.exponent == pytest.approx(16.0, rel=0.02)
    silent = dataclasses.replace(fine, noise=None)
    found = fit_compaction(dataclasses.replace(PLY, compaction=(rough, silent)))
    assert 10.0 < found.compaction.exponent < 15.0


def test_an_onset_that_the_data_do_not_tell_is_assumed():
    """Far above the onset, thickness is a power of pressure alone."""
    p = np.geomspace(0.02, 1.0, 20)
    h = 0.4 * (0.05 / p) ** (1 / 12)
    test = pressed_sheet(SOFT).compaction[0]
    response = dataclasses.replace(test.response, values=h, gain=np.ones(20))
    test = dataclasses.replace(test, pressure=p, response=response, rows=np.arange(20))
    found = fit_compaction(dataclasses.replace(PLY, compaction=(test,)))
    onset = found.assumed["onset"]
    assert (onset.value, onset.source) == (ff.Compaction.onset, "default")
    assert "the data do not tell it" in onset.reason
    assert found.compaction.exponent == pytest.approx(12.0, rel=0.1)
    assert PLY.thickness * found.compaction.thickness(p) == pytest.approx(h, rel=0.005)


def test_a_data_set_gives_the_fabric_its_compaction(tmp_path):
    known = ff.load("komeili").replace(compaction=SOFT, fibre_density=2.54)
    sheet, curves = synthesise(known, "all", 0.005)
    assert len(sheet.compaction) == 1 and sheet.fibre_density == 2.54
    result = identify(sheet, curves)
    assert result.fabric.fibre_density == 2.54
    assert result.fabric.compaction.exponent == pytest.approx(9.0, rel=0.1)
    assert result.report()["compaction"]["determined"]["onset"]["unit"] == "MPa"
    result.fabric.to_toml(tmp_path / "x.toml", result.remarks())
    assert ff.load(tmp_path / "x.toml") == result.fabric
    assert f"{tmp_path / 'x'}_compaction.png" in draw(result, tmp_path / "x")


def test_without_a_test_compaction_is_the_default(tmp_path):
    result = identify(*data.read(folder(tmp_path, pull=UNIAXIAL)))
    assert result.fabric.compaction == ff.Compaction() and result.report()["compaction"] is None
    assert "compaction is assumed (default): there is no test of it" in result.remarks()


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


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (text_of(P[::-1], H), "row 4: pressure is 0.1 MPa after 1 MPa; allowed is to"),
        (text_of(P, H[::-1]), "thickness is 0.4 mm under the highest pressure and 0.28 mm under"),
        (
            "# test: compaction\npressure [MPa],thickness [mm],fibre_volume_fraction [-]\n"
            + "".join(f"{p},{h},{0.1 / h}\n" for p, h in zip(P, H)),
            "both columns thickness and fibre_volume_fraction; allowed is one of them",
        ),
    ],
)
def test_useless_data_are_refused(tmp_path, text, words):
    folder(tmp_path, SHEET.replace("1.2", "0.4"), pull=UNIAXIAL, pressed=text)
    with pytest.raises(InputError) as error:
        data.read(tmp_path)
    assert "pressed.csv" in str(error.value) and words in str(error.value)


def test_what_does_not_tell_the_exponent_is_refused():
    with pytest.raises(InputError, match="leave the exponent at .*; allowed are tests that tell"):
        fit_compaction(pressed_sheet(KNOWN[2], (0.1, 3), points=6))


def test_plies_of_another_thickness_are_refused():
    """As of a stack of five."""
    sheet = dataclasses.replace(pressed_sheet(SOFT), thickness=0.08)
    words = r"thickness is 0.08 mm, and plies of .* have 0.4.* to 0.2.* \(divide that of a stack"
    with pytest.raises(InputError, match=words):
        fit_compaction(sheet)


def test_of_a_loop_the_loading_is_fitted(tmp_path):
    text = text_of([*P, 0.1, 0.001], [*H, 0.25, 0.35])
    sheet, _ = data.read(folder(tmp_path, SHEET.replace("1.2", "0.4"), pull=UNIAXIAL, pressed=text))
    (test,) = sheet.compaction
    assert test.pressure.tolist() == P
    assert "pressure turns back behind row 6" in test.remarks[0]
