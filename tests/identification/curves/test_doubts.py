"""Test curves that can be read and still are doubted: long strains, tests that contradict each
other."""

import pytest
from curve_texts import FREE, SHEET, UNIAXIAL, folder, scaled
from synthetic_curves import synthesise

from fabric_fenicsx.identification import curves as data
from fabric_fenicsx.material.presets import PRESETS
from fabric_fenicsx.runtime.errors import InputError

KOMEILI = PRESETS["komeili"]


def test_long_strains_are_doubted(tmp_path):
    text = (
        UNIAXIAL.replace("eps_a [%]", "eps_a [-]")
        .replace("1.5,22", "0.2,22")
        .replace("0.5,6.9", "0.1,6.9")
    )
    text = (
        text.replace("1,14.5", "0.15,14.5")
        .replace("2,31.6", "0.25,31.6")
        .replace("2.5,41.1", "0.4,41.1")
    )
    _, curves = data.read(folder(tmp_path, warp=text.replace("0.0.25", "0.25")))
    (warning,) = data.curve_warnings(curves)
    assert warning.startswith(
        "warp.csv: a yarn is stretched by 40 %, where fabrics have up to 20 %"
    )


def test_contradictions(tmp_path):
    with pytest.raises(
        InputError,
        match=(
            r"warp.csv, row 11: sigma_a contradicts sigma_a of warp2.csv, as they "
            r"differ by \d+ % of their peak"
        ),
    ):
        data.read(folder(tmp_path, warp=UNIAXIAL, warp2=scaled(UNIAXIAL, 2)))
    (tmp_path / "warp2.csv").write_text(scaled(UNIAXIAL, 1.3))  # ordinary scatter
    assert len(data.read(tmp_path)[1]) == 2
    (tmp_path / "warp2.csv").write_text(
        scaled(UNIAXIAL, 2).replace("2 % of maximum", "20 % of value")
    )  # the noise allows it
    assert len(data.read(tmp_path)[1]) == 2


def test_a_copy_is_no_second_test(tmp_path):
    with pytest.raises(
        InputError,
        match=r"warp2.csv has the values of warp.csv, row by row; allowed is each test once",
    ):
        data.read(folder(tmp_path, warp=UNIAXIAL, warp2=UNIAXIAL))
    (tmp_path / "warp2.csv").write_text(FREE)  # nor one of another kind
    with pytest.raises(InputError, match=r"warp2.csv has the values of warp.csv"):
        data.read(tmp_path)


def test_free_sides_make_no_fabric_stiffer(tmp_path):
    folder(tmp_path, held=UNIAXIAL, strip=scaled(FREE, 2))
    with pytest.raises(
        InputError,
        match=(
            r"held.csv, row \d+: with lateral: held sigma_a is \d+ % of the peak .* "
            r"of strip.csv .* exchanged\?"
        ),
    ):
        data.read(tmp_path)
    (tmp_path / "strip.csv").write_text(scaled(FREE, 0.6))
    assert len(data.read(tmp_path)[1]) == 2


def test_warp_and_weft_of_a_balanced_fabric_contradict(tmp_path):
    weft = (
        scaled(UNIAXIAL, 0.4)
        .replace("uniaxial_a", "uniaxial_b")
        .replace("eps_a", "eps_b")
        .replace("sigma_a", "sigma_b")
    )
    with pytest.raises(InputError, match="if warp and weft differ, say balanced = false"):
        data.read(folder(tmp_path, warp=UNIAXIAL, weft=weft))
    assert (
        len(
            data.read(folder(tmp_path, SHEET.replace("true", "false"), warp=UNIAXIAL, weft=weft))[1]
        )
        == 2
    )


def test_other_states_do_not_contradict(unbalanced):
    for fabric in (KOMEILI, unbalanced):
        sheet, curves = synthesise(fabric, "all", 0.02)
        data.check_contradictions(curves, sheet.balanced)
