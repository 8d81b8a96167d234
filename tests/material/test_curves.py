"""Test curves: files, units, what wrong files say, and the power balances behind shear forces."""

import math
import re

import numpy as np
import pytest

from fabric_fenicsx.errors import InputError
from fabric_fenicsx.material import curves as data
from fabric_fenicsx.material.identify import nominal, synthesise
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
SHEAR = "# test: shear\ngamma [deg],F_sh [N/mm]\n10,0.016\n20,0.035\n30,0.056\n35,0.078\n40,0.110\n"
BIAS = "# test: bias_extension\n# height: 230 mm\n# width: 11.5 cm\ngamma [deg],F [N]\n10,1\n20,2\n30,3\n35,4\n40,5\n"


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
        UNIAXIAL.replace("eps_a [%],sigma_a [MPa]", " sigma_a[kPa] , eps_a [ % ]").replace("0.5,6.9", "6900,0.5").replace("1,14.5", "14500,1")
        .replace("1.5,22.8", "22800,1.5").replace("2,31.6", "31600,2").replace("2.5,41.1", "41100,2.5"),
    ],
)  # fmt: skip
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
        assert (two.test, two.free, two.noise, two.abscissa) == (one.test, one.free, one.noise, one.abscissa)
        assert two.strains == pytest.approx(one.strains, rel=1e-11, abs=0)
        for r, q in zip(one.responses, two.responses, strict=True):
            assert (r.column, r.unit) == (q.column, q.unit) and q.values == pytest.approx(r.values, rel=1e-11)


@pytest.mark.parametrize(
    ("text", "old", "new", "sentence"),
    [
        (UNIAXIAL, "# test: uniaxial_a\n", "", "no line `# test: ...` states the test; allowed are uniaxial_a, uniaxial_b, biaxial"),
        (UNIAXIAL, "uniaxial_a", "uniaxal_a", "row 2: test 'uniaxal_a' is unknown (did you mean uniaxial_a?); allowed are"),
        (UNIAXIAL, "# lateral: held", "", "the test uniaxial_a needs a line for lateral; allowed is `# lateral: held`"),
        (UNIAXIAL, "held", "clamped", "row 3: lateral is 'clamped'; allowed is held or free"),
        (UNIAXIAL, "held", "free", "row 5: the column eps_b is missing, which the test uniaxial_a needs"),
        (UNIAXIAL, "# noise:", "# nosie:", "row 4: the key nosie is unknown (did you mean noise?)"),
        (UNIAXIAL, "# noise:", "# height:", "row 4: the key height does not belong to the test uniaxial_a; allowed are noise, lateral"),
        (UNIAXIAL, "2 % of maximum", "2 %", "row 4: noise is '2 %'; allowed is `2 % of maximum` or `2 % of value`"),
        (UNIAXIAL, "2 % of maximum", "0 % of value", "row 4: noise is '0 %', but it must be a number above 0"),
        (UNIAXIAL, "2 % of maximum", "1 psi", "row 4: noise is '1 psi', but it must be a number above 0 with one of the units MPa, kPa"),
        (UNIAXIAL, ",sigma_a [MPa]", "", "row 5: the column sigma_a is missing, which the test uniaxial_a needs"),
        (UNIAXIAL, "sigma_a [MPa]", "sigma_b [MPa]", "row 5: the column sigma_a is missing"),
        (SHEAR, ",F_sh [N/mm]", "", "row 2: the column tau or F_sh is missing, which the test shear needs"),
        (SHEAR, ",F_sh [N/mm]", ",F_sh [N/mm],tau [MPa]", "there are 2 cells under 3 columns"),
        (UNIAXIAL, "sigma_a [MPa]", "stress [MPa]", "row 5: column 'stress' is unknown; allowed are eps_a, sigma_a, sigma_b"),
        (UNIAXIAL, "sigma_a [MPa]", "tau [MPa]", "row 5: the column tau does not belong to the test uniaxial_a; allowed are eps_a, sigma_a"),
        (UNIAXIAL, "sigma_a [MPa]", "sigma_a [psi]", "row 5: unit [psi] of column sigma_a is unknown; allowed are MPa, kPa, Pa, GPa, N/mm2"),
        (UNIAXIAL, "sigma_a [MPa]", "sigma_a", "row 5: the column sigma_a has no unit; write sigma_a [MPa], for example"),
        (UNIAXIAL, "sigma_a [MPa]", "eps_a [-]", "row 5: the column eps_a is repeated; allowed is once"),
        (UNIAXIAL, "eps_a [%],sigma_a [MPa]", "sigma_a [MPa],sigma_b [MPa]", "row 5: the column eps_a is missing"),
        (UNIAXIAL, "1.5,22.8", "0.9,22.8", "row 9: eps_a is 0.009 after 0.01, but it must rise or fall strictly"),
        (UNIAXIAL, "1.5,22.8", "1,22.8", "row 9: eps_a is 0.01 after 0.01, but it must rise or fall strictly"),
        (UNIAXIAL, "22.8", "nan", "row 9: sigma_a is 'nan', but it must be a finite number with a decimal point"),
        (UNIAXIAL, "22.8", "", "row 9: sigma_a is '', but it must be a finite number"),
        (UNIAXIAL, "1.5,22.8", "1,5,22,8", "row 9: there are 4 cells under 2 columns"),
        (UNIAXIAL, "2.5,41.1\n", "", "row 10: the file ends after 4 points; at least 5 are needed"),
        (UNIAXIAL, "eps_a [%]", "eps_a [-]", "row 7: eps_a is 1 -, but it must be within +-0.5 (is the unit in the header right?)"),
        (UNIAXIAL, "0.5,6.9", "-0.5,6.9", "row 6: eps_a is -0.005, but in the test uniaxial_a it must be at least 0"),
        (SHEAR, "[deg]", "[rad]", "row 3: gamma is 10 rad, but it must be within +-1.48 (is the unit in the header right?)"),
        (SHEAR, "gamma [deg],F_sh [N/mm]", "gamma [deg],sigma_a [MPa]", "the column sigma_a does not belong to the test shear"),
        (re.sub(r"0\.\d+", "0", SHEAR), "", "", "row 3: F_sh is 0 in every row, so there is nothing to fit"),
        (BIAS, "# width: 11.5 cm\n", "", "the test bias_extension needs a line for width; allowed is `# width: 200 mm`, for example"),
        (BIAS, "11.5 cm", "11.5", "row 3: width is '11.5', but it must be a number above 0 with one of the units mm, cm, m"),
        (BIAS, "11.5 cm", "15 cm", "height is 230 mm and width 150 mm; allowed is a height of 2 widths or more"),
        ("# test: shear\n", "", "", "there is no header; allowed is a line such as"),
        ("# test: shear\ngamma [deg],tau [MPa]\n", "", "", "row 2: the file ends after 0 points"),
    ],
)  # fmt: skip
def test_bad_files(tmp_path, text, old, new, sentence):
    assert old in text
    path = folder(tmp_path, bad=text.replace(old, new, 1)) / "bad.csv"
    with pytest.raises(InputError, match=re.escape(f"{path}: ") + ".*" + re.escape(sentence)) as error:
        data.read(tmp_path)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("balanced = true", "", "balanced is None; allowed is true (warp and weft are equal) or false"),
        ("thickness_mm = 1.2", "", "missing thickness"),
        ("thickness_mm = 1.2", "thickness_inch = 1", "thickness_inch: length unit 'inch' is unknown"),
        ("thickness_mm = 1.2", "thickness_mm = -1", "thickness_mm is -1, but it must be a finite number, above 0"),
        (
            "balanced = true",
            "balanced = true\n[assumed]\np_min = 2",
            "assumed.p_min is 2, but it must be a finite number, from 0 to 1",
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


def test_assumed_values(tmp_path):
    text = SHEET.replace("true", "false") + "[assumed]\nd_kPa = 900\nc = 20\n[assumed.weft]\nd_MPa = 2\n"
    assert data.read_sheet(folder(tmp_path, text) / "sheet.toml").assumed == {"d": 0.9, "c": 20.0, "weft.d": 2.0}


def scaled(text, factor):
    return re.sub(r",([\d.]+)$", lambda m: f",{float(m[1]) * factor:.6g}", text, flags=re.M)


def test_contradictions(tmp_path):
    with pytest.raises(
        InputError,
        match=r"warp.csv, row 11: sigma_a contradicts sigma_a of warp2.csv, as they differ by \d+ % of their peak",
    ):
        data.read(folder(tmp_path, warp=UNIAXIAL, warp2=scaled(UNIAXIAL, 2)))
    (tmp_path / "warp2.csv").write_text(scaled(UNIAXIAL, 1.3))  # ordinary scatter
    assert len(data.read(tmp_path)[1]) == 2
    (tmp_path / "warp2.csv").write_text(
        scaled(UNIAXIAL, 2).replace("2 % of maximum", "20 % of value")
    )  # the noise allows it
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
    assert len(data.read(folder(tmp_path, SHEET.replace("true", "false"), warp=UNIAXIAL, weft=weft))[1]) == 2


def test_other_states_do_not_contradict(unbalanced):
    for fabric in (KOMEILI, unbalanced):
        sheet, curves = synthesise(fabric, "all", 0.02)
        data.check_contradictions(curves, sheet.balanced)


def test_shear_force_is_the_part_of_the_traction_along_the_yarn():
    """F_sh / t = S12 of the kernel at unstrained yarns, so tau t = F_sh cos(gamma)."""
    from fabric_fenicsx.material.pointwise import evaluate

    g = np.linspace(0.1, 1.2, 12)
    C = np.stack([np.ones(12), np.sin(g), np.sin(g), np.ones(12)], -1).reshape(-1, 2, 2)
    tau = nominal(KOMEILI, np.outer(g, [0, 0, 1]))[:, 2]
    response = data._response("F_sh", tau, g, "shear", {}, 1.2)
    assert response.gain * tau / 1.2 == pytest.approx(evaluate(KOMEILI, cauchy_green=C).S[:, 0, 1], rel=1e-12)
    assert tau == pytest.approx((0.02506 - 0.18679 * g + 0.56239 * g**2) * g, rel=1e-12)


def test_forces_do_the_work_that_the_fabric_stores():
    """The integral of the crosshead force over its way is the energy of all zones of the specimen."""
    g = np.linspace(0, math.radians(50), 20001)
    t, W, H, frame, fabric = 1.2, 115.0, 230.0, 200.0, 140.0

    def tau(g):
        return (0.02506 - 0.18679 * g + 0.56239 * g**2) * g

    def energy(g):
        return 0.02506 * g**2 / 2 - 0.18679 * g**3 / 3 + 0.56239 * g**4 / 4

    bias = data._response("F", g, g, "bias_extension", {"height": H, "width": W}, t)
    force = bias.gain * tau(g) + bias.half * tau(g / 2)
    way = (H - W) * (np.cos(g / 2) + np.sin(g / 2) - 1)
    stored = t * (W * (2 * H - 3 * W) / 2 * energy(g[-1]) + W**2 * energy(g[-1] / 2))
    assert np.trapz(force, way) == pytest.approx(stored, rel=1e-7)
    picture = data._response("F", g, g, "picture_frame", {"frame_length": frame, "fabric_length": fabric}, t)
    way = 2 * frame * np.cos(math.pi / 4 - g / 2)
    assert np.trapz(picture.gain * tau(g), way) == pytest.approx(t * fabric**2 * energy(g[-1]), rel=1e-7)


def test_normalisation_of_a_bias_test():
    """The formula of Cao et al. gives back F_sh = tau t / cos(gamma) from the force that the law predicts."""
    g = np.linspace(0.01, math.radians(50), 400)
    tau = lambda g: (0.02506 - 0.18679 * g + 0.56239 * g**2) * g  # noqa: E731
    for H, W in ((230.0, 115.0), (450.0, 150.0)):
        bias = data._response("F", g, g, "bias_extension", {"height": H, "width": W}, 1.2)
        found = data.bias_normalised(g, bias.gain * tau(g) + bias.half * tau(g / 2), H, W)
        # what is left is the interpolation at gamma / 2
        assert found == pytest.approx(1.2 * tau(g) / np.cos(g), rel=2e-4, abs=5e-5 * tau(g[-1]))
