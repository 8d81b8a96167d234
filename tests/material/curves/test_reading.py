"""Test curves: files, units, what wrong files say, and the power balances behind shear forces."""

import re

import numpy as np
import pytest

from fabric_fenicsx.errors import InputError
from fabric_fenicsx.material import curves as data
from fabric_fenicsx.material.identification import synthesise
from fabric_fenicsx.material.presets import PRESETS

KOMEILI = PRESETS["komeili"]
SHEET = 'name = "x"\nthickness_mm = 1.2\ndensity_g_per_cm3 = 0.6\nbalanced = true\n'
UNIAXIAL = """# any remark: is ignored
# test: uniaxial_a
# lateral: held
# noise: 2 % of maximum
eps_a [%],sigma_a [MPa]
0.5,6.9
1,14.5

1.5,22.8
2,31.6
2.5,41.1
"""
FREE = UNIAXIAL.replace("held", "free")
# values that are fractions, and radians
PERCENT = "# test: uniaxial_a\n# lateral: free\neps_a [%],sigma_a [MPa]\n" + "".join(
    f"{i / 200},{i}\n" for i in (1, 2, 3, 4, 6)
)
PERCENT = PERCENT.replace("0.005,1\n", "0.002,0.5\n0.005,1\n").replace("0.03,6", "0.03,6")
RADIANS = "# test: shear\ngamma [deg],tau [MPa]\n0.1,1\n0.2,2\n0.4,4\n0.6,6\n0.8,9\n"
WIDENED = "# test: uniaxial_b\n# lateral: free\neps_b [%],sigma_b [MPa],eps_a [%]\n" + "".join(
    f"{i},{i},{i * 2}\n" for i in range(1, 6)
)
FRAME = (
    "# test: picture_frame\n# frame_length: 140 mm\n# fabric_length: 20 cm\ngamma [deg],F [N]\n"
    "10,1\n20,2\n30,3\n35,4\n40,5\n"
)
SHEAR = "# test: shear\ngamma [deg],F_sh [N/mm]\n10,0.016\n20,0.035\n30,0.056\n35,0.078\n40,0.110\n"
BIAS = (
    "# test: bias_extension\n# height: 230 mm\n# width: 11.5 cm\ngamma [deg],F [N]\n"
    "10,1\n20,2\n30,3\n35,4\n40,5\n"
)


def folder(tmp_path, sheet=SHEET, **files):
    (tmp_path / "sheet.toml").write_text(sheet)
    for name, text in files.items():
        (tmp_path / f"{name}.csv").write_text(text, encoding="utf-8")
    return tmp_path


def test_a_file_is_read(tmp_path):
    sheet, (curve,) = data.read(folder(tmp_path, warp=UNIAXIAL))
    assert sheet == data.Sheet("x", 1.2, 0.6, True)
    assert (curve.file, curve.test, curve.free, curve.noise, curve.abscissa) == (
        "warp.csv",
        "uniaxial_a",
        None,
        ("maximum", 0.02),
        0,
    )
    assert curve.strains == pytest.approx(np.outer([0.005, 0.01, 0.015, 0.02, 0.025], [1, 0, 0]))
    assert curve.rows.tolist() == [6, 7, 9, 10, 11]
    assert curve.responses[0].values.tolist() == [6.9, 14.5, 22.8, 31.6, 41.1]


@pytest.mark.parametrize(
    "text",
    [
        UNIAXIAL.replace(",", ";"),
        "\ufeff" + UNIAXIAL,
        UNIAXIAL.replace("\n", "\r\n"),
        UNIAXIAL.replace("eps_a [%],sigma_a [MPa]", " sigma_a[kPa] , eps_a [ % ]")
        .replace("0.5,6.9", "6900,0.5")
        .replace("1,14.5", "14500,1")
        .replace("1.5,22.8", "22800,1.5")
        .replace("2,31.6", "31600,2")
        .replace("2.5,41.1", "41100,2.5"),
    ],
)
def test_spellings_give_the_same_curve(tmp_path, text):
    _, (curve,) = data.read(folder(tmp_path, warp=text))
    assert curve.strains[:, 0] == pytest.approx([0.005, 0.01, 0.015, 0.02, 0.025])
    assert curve.responses[0].values == pytest.approx([6.9, 14.5, 22.8, 31.6, 41.1])


def test_written_data_read_back(tmp_path, unbalanced):
    sheet, curves = synthesise(unbalanced, "all", 0.02)
    data.write(tmp_path / "new", sheet, curves, ["synthetic"])
    again, read = data.read(tmp_path / "new")
    assert again == sheet and {c.file for c in read} == {c.file for c in curves}
    for one in curves:
        two = next(c for c in read if c.file == one.file)
        assert (two.test, two.free, two.noise, two.abscissa) == (
            one.test,
            one.free,
            one.noise,
            one.abscissa,
        )
        assert two.strains == pytest.approx(one.strains, rel=1e-11, abs=0)
        for r, q in zip(one.responses, two.responses, strict=True):
            assert (r.column, r.unit) == (q.column, q.unit)
            assert q.values == pytest.approx(r.values, rel=1e-11)


@pytest.mark.parametrize(
    ("text", "old", "new", "sentence"),
    [
        (
            UNIAXIAL,
            "# test: uniaxial_a\n",
            "",
            "no line `# test: ...` states the test; allowed are uniaxial_a, uniaxial_b, biaxial",
        ),
        (
            UNIAXIAL,
            "uniaxial_a",
            "uniaxal_a",
            "row 2: test 'uniaxal_a' is unknown (did you mean uniaxial_a?); allowed are",
        ),
        (
            UNIAXIAL,
            "# lateral: held",
            "",
            "the test uniaxial_a needs a line for lateral; allowed is `# lateral: held`",
        ),
        (UNIAXIAL, "held", "clamped", "row 3: lateral is 'clamped'; allowed is held or free"),
        (
            UNIAXIAL,
            "sigma_a [MPa]",
            "eps_b [%]",
            (
                "row 5: lateral: held says that eps_b is 0, but there is a column eps_b; "
                "allowed is `# lateral: free`"
            ),
        ),
        (
            FREE,
            "sigma_a [MPa]",
            "sigma_b [MPa]",
            (
                "row 5: lateral: free says that sigma_b is 0, but there is a column sigma_b; "
                "allowed is `# lateral: held`"
            ),
        ),
        (
            FREE,
            "sigma_a [MPa]",
            "F [N]",
            (
                "row 5: the column F needs the strip's width; allowed is the force over "
                "the width, sigma_a [N/mm]"
            ),
        ),
        (FREE, "sigma_a [MPa]", "sigma_a [N]", "row 5: unit [N] of column sigma_a is unknown"),
        (FREE, "22.8", "-inf", "row 9: sigma_a is '-inf'; allowed is a finite number"),
        (
            FREE,
            "41.1",
            "-410.1",
            (
                "row 11: sigma_a is -410.1 MPa; allowed is at least 0, of the test "
                "uniaxial_a (is its sign turned?)"
            ),
        ),
        (
            FREE,
            "41.1",
            "4.1",
            (
                "row 11: sigma_a has fallen to 13 % of its value in row 10; allowed is 50 % or "
                "more (keep the rows before yarns break)"
            ),
        ),
        (
            FREE,
            "0.5,6.9",
            "0,9",
            (
                "row 6: sigma_a is 9 MPa before anything is strained; allowed is up to 20 % of "
                "its peak there (take the offset off)"
            ),
        ),
        (
            PERCENT,
            "",
            "",
            (
                "row 9: eps_a reaches 0.03 % only; allowed is 0.05 % or more (is "
                "the unit - rather than %?)"
            ),
        ),
        (
            RADIANS,
            "",
            "",
            (
                "row 7: gamma reaches 0.8 deg only; allowed is 1.6 deg or more (is the "
                "unit rad rather than deg?)"
            ),
        ),
        (
            WIDENED,
            "",
            "",
            "row 8: eps_a is 0.1; allowed is at most 0, free sides narrow (is its sign turned?)",
        ),
        (
            UNIAXIAL,
            "2 % of maximum",
            "150 % of value",
            (
                "row 4: noise is '150 % of value', which leaves nothing measured; "
                "allowed is below 100 %"
            ),
        ),
        (
            UNIAXIAL,
            "2 % of maximum",
            "-1 N/mm",
            "row 4: noise is '-1 N/mm'; allowed is a number above 0 with one of the units",
        ),
        (
            FRAME,
            "",
            "",
            (
                "fabric_length is 200 mm and frame_length 140 mm; allowed is a fabric up "
                "to as large as its frame"
            ),
        ),
        (UNIAXIAL, "# noise:", "# nosie:", "row 4: the key nosie is unknown (did you mean noise?)"),
        (
            UNIAXIAL,
            "# noise:",
            "# height:",
            (
                "row 4: the key height does not belong to the test uniaxial_a; "
                "allowed are noise, lateral"
            ),
        ),
        (
            UNIAXIAL,
            "2 % of maximum",
            "2 %",
            "row 4: noise is '2 %'; allowed is `2 % of maximum` or `2 % of value`",
        ),
        (
            UNIAXIAL,
            "2 % of maximum",
            "0 % of value",
            "row 4: noise is '0 %'; allowed is a number above 0",
        ),
        (
            UNIAXIAL,
            "2 % of maximum",
            "1 psi",
            ("row 4: noise is '1 psi'; allowed is a number above 0 with one of the units MPa, kPa"),
        ),
        (
            UNIAXIAL,
            ",sigma_a [MPa]",
            "",
            "row 5: the column sigma_a is missing, which the test uniaxial_a needs",
        ),
        (UNIAXIAL, "sigma_a [MPa]", "sigma_b [MPa]", "row 5: the column sigma_a is missing"),
        (
            SHEAR,
            ",F_sh [N/mm]",
            "",
            "row 2: the column tau or F_sh is missing, which the test shear needs",
        ),
        (SHEAR, ",F_sh [N/mm]", ",F_sh [N/mm],tau [MPa]", "there are 2 cells under 3 columns"),
        (
            UNIAXIAL,
            "sigma_a [MPa]",
            "stress [MPa]",
            "row 5: column 'stress' is unknown; allowed are eps_a, sigma_a, sigma_b",
        ),
        (
            UNIAXIAL,
            "sigma_a [MPa]",
            "tau [MPa]",
            (
                "row 5: the column tau does not belong to the test uniaxial_a; "
                "allowed are eps_a, sigma_a"
            ),
        ),
        (
            UNIAXIAL,
            "sigma_a [MPa]",
            "sigma_a [psi]",
            "row 5: unit [psi] of column sigma_a is unknown; allowed are MPa, kPa, Pa, GPa, N/mm2",
        ),
        (
            UNIAXIAL,
            "sigma_a [MPa]",
            "sigma_a",
            "row 5: the column sigma_a has no unit; allowed is sigma_a [MPa], for example",
        ),
        (
            UNIAXIAL,
            "sigma_a [MPa]",
            "eps_a [-]",
            "row 5: the column eps_a is repeated; allowed is once",
        ),
        (
            UNIAXIAL,
            "eps_a [%],sigma_a [MPa]",
            "sigma_a [MPa],sigma_b [MPa]",
            "row 5: the column eps_a is missing",
        ),
        (
            UNIAXIAL,
            "1.5,22.8",
            "0.9,22.8",
            "row 9: eps_a is 0.009 after 0.01; allowed is to rise or fall strictly",
        ),
        (
            UNIAXIAL,
            "1.5,22.8",
            "1,22.8",
            "row 9: eps_a is 0.01 after 0.01; allowed is to rise or fall strictly",
        ),
        (
            UNIAXIAL,
            "22.8",
            "nan",
            "row 9: sigma_a is 'nan'; allowed is a finite number with a decimal point",
        ),
        (UNIAXIAL, "22.8", "", "row 9: sigma_a is ''; allowed is a finite number"),
        (UNIAXIAL, "1.5,22.8", "1,5,22,8", "row 9: there are 4 cells under 2 columns"),
        (UNIAXIAL, "2.5,41.1\n", "", "row 10: the file ends after 4 points; allowed is 5 or more"),
        (
            UNIAXIAL,
            "eps_a [%]",
            "eps_a [-]",
            "row 7: eps_a is 1 -; allowed is within +-0.5 (is the unit in the header right?)",
        ),
        (
            UNIAXIAL,
            "0.5,6.9",
            "-0.5,6.9",
            "row 6: eps_a is -0.005; allowed is at least 0 in the test uniaxial_a",
        ),
        (
            SHEAR,
            "[deg]",
            "[rad]",
            ("row 3: gamma is 10 rad; allowed is within +-1.48 (is the unit in the header right?)"),
        ),
        (
            SHEAR,
            "gamma [deg],F_sh [N/mm]",
            "gamma [deg],sigma_a [MPa]",
            "the column sigma_a does not belong to the test shear",
        ),
        (
            re.sub(r"0\.\d+", "0", SHEAR),
            "",
            "",
            "row 3: F_sh is 0 in every row, so there is nothing to fit",
        ),
        (
            BIAS,
            "# width: 11.5 cm\n",
            "",
            (
                "the test bias_extension needs a line for width; allowed is `# "
                "width: 200 mm`, for example"
            ),
        ),
        (
            BIAS,
            "11.5 cm",
            "11.5",
            ("row 3: width is '11.5'; allowed is a number above 0 with one of the units mm, cm, m"),
        ),
        (
            BIAS,
            "11.5 cm",
            "15 cm",
            "height is 230 mm and width 150 mm; allowed is a height of 2 widths or more",
        ),
        ("# test: shear\n", "", "", "there is no header; allowed is a line such as"),
        ("# test: shear\ngamma [deg],tau [MPa]\n", "", "", "row 2: the file ends after 0 points"),
    ],
)
def test_bad_files(tmp_path, text, old, new, sentence):
    assert old in text
    path = folder(tmp_path, bad=text.replace(old, new, 1)) / "bad.csv"
    with pytest.raises(
        InputError, match=re.escape(f"{path}: ") + ".*" + re.escape(sentence)
    ) as error:
        data.read(tmp_path)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        (
            "balanced = true",
            "",
            "balanced is None; allowed is true (warp and weft are equal) or false",
        ),
        (
            "thickness_mm = 1.2",
            "",
            "missing thickness; allowed is thickness_mm = 1.2, for example: by it a force per "
            "width",
        ),
        (
            "density_g_per_cm3 = 0.6",
            "",
            "missing density; allowed is density_g_per_cm3 or areal_weight_g_per_m2",
        ),
        (
            "balanced",
            "areal_weight_g_per_m2 = 700\nbalanced",
            "density and areal_weight are both given; allowed is one",
        ),
        (
            "density_g_per_cm3 = 0.6",
            "areal_weight = 700",
            "areal_weight has no unit; allowed is areal_weight_g_per_m2 or",
        ),
        (
            "density_g_per_cm3 = 0.6",
            "areal_weight_g_per_cm3 = 7",
            "areal_weight_g_per_cm3: areal_weight unit 'g_per_cm3'",
        ),
        (
            "density_g_per_cm3 = 0.6",
            "areal_weight_g_per_m2 = nan",
            "areal_weight_g_per_m2 is nan; allowed is a finite",
        ),
        (
            "thickness_mm = 1.2",
            "thickness_inch = 1",
            "thickness_inch: length unit 'inch' is unknown",
        ),
        (
            "thickness_mm = 1.2",
            "thickness_mm = -1",
            "thickness_mm is -1; allowed is a finite number, above 0",
        ),
        (
            "balanced = true",
            "balanced = true\n[assumed]\np_min = 2",
            "assumed.p_min is 2; allowed is a finite number, from 0 to 1",
        ),
        (
            "balanced = true",
            "balanced = true\n[assumed.warp]\np_min = 1",
            "assumed.warp is given for a balanced fabric",
        ),
        ("balanced = true", "balanced = ", "is not valid TOML"),
    ],
)
def test_bad_sheets(tmp_path, old, new, sentence):
    path = folder(tmp_path, SHEET.replace(old, new, 1), warp=UNIAXIAL) / "sheet.toml"
    with pytest.raises(InputError, match=re.escape(f"{path}: ") + ".*" + re.escape(sentence)):
        data.read(tmp_path)


def test_bad_folders(tmp_path):
    with pytest.raises(InputError, match="none is not a folder; allowed is one with a sheet.toml"):
        data.read(tmp_path / "none")
    with pytest.raises(InputError, match=r"sheet.toml: cannot be read \(No such file"):
        data.read(tmp_path)
    with pytest.raises(InputError, match=r"has no \*.csv"):
        data.read(folder(tmp_path))
    (tmp_path / "bytes.csv").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match="bytes.csv: cannot be read as text"):
        data.read(tmp_path)


def test_areal_weight_is_a_density(tmp_path):
    text = SHEET.replace("density_g_per_cm3 = 0.6", "areal_weight_g_per_m2 = 743")
    sheet = data.read_sheet(folder(tmp_path, text) / "sheet.toml")
    assert sheet.density == pytest.approx(0.743 / 1.2, rel=1e-14) and sheet.areal_weight == 743
    text = text.replace("_g_per_m2 = 743", " = 0.743") + '[units]\nareal_weight = "kg/m2"\n'
    assert data.read_sheet(folder(tmp_path, text) / "sheet.toml") == sheet


@pytest.mark.parametrize(
    ("text", "column", "unit", "factor"),
    [
        (FREE, "sigma_a", "N/mm", 1.2),
        (UNIAXIAL, "sigma_a", "kN/m", 1.2),
        (SHEAR.replace("F_sh [N/mm]", "tau [MPa]"), "tau", "N/m", 1200.0),
    ],
)
def test_forces_per_width_are_divided_by_the_thickness(tmp_path, text, column, unit, factor):
    text = text.replace("2 % of maximum", "0.3 MPa")
    first, second = (tmp_path / name for name in ("first.csv", "second.csv"))
    first.write_text(text)
    per_width = scaled(text, factor).replace(f"{column} [MPa]", f"{column} [{unit}]")
    second.write_text(per_width.replace("0.3 MPa", f"{0.3 * factor} {unit}"))
    one, two = (data.read_curve(path, 1.2) for path in (first, second))
    assert two.responses[0].values == pytest.approx(one.responses[0].values, rel=1e-5)
    assert two.responses[0].unit == "MPa"
    assert (one.noise is None) == (two.noise is None)
    assert one.noise is None or two.noise[1] == pytest.approx(one.noise[1])


def test_a_strip_with_free_sides_needs_no_width(tmp_path):
    _, (curve,) = data.read(folder(tmp_path, strip=FREE))
    assert curve.free == 0 and [r.column for r in curve.responses] == ["sigma_a"]
    with_width = "\n".join(
        line + ",-2" if line[:1].isdigit() else line for line in FREE.splitlines()
    )
    (tmp_path / "strip.csv").write_text(
        with_width.replace("sigma_a [MPa]", "sigma_a [MPa],eps_b [%]")
    )
    (curve,) = data.read(tmp_path)[1]
    assert curve.free == 0 and [r.column for r in curve.responses] == ["sigma_a", "eps_b"]


def test_files_end_in_csv_of_any_case(tmp_path):
    folder(tmp_path, warp=UNIAXIAL)
    (tmp_path / "SHEAR.CSV").write_text(SHEAR)
    assert [curve.file for curve in data.read(tmp_path)[1]] == ["SHEAR.CSV", "warp.csv"]


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
    (warning,) = data.unit_warnings(curves)
    assert warning.startswith(
        "warp.csv: a yarn is stretched by 40 %, where fabrics have up to 20 %"
    )


def test_assumed_values(tmp_path):
    text = (
        SHEET.replace("true", "false")
        + "[assumed]\nd_kPa = 900\nc = 20\n[assumed.weft]\nd_MPa = 2\n"
    )
    assert data.read_sheet(folder(tmp_path, text) / "sheet.toml").assumed == {
        "d": 0.9,
        "c": 20.0,
        "weft.d": 2.0,
    }


def scaled(text, factor):
    return re.sub(r",([\d.]+)$", lambda m: f",{float(m[1]) * factor:.6g}", text, flags=re.M)


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
