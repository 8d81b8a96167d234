"""What wrong files of test curves say: file, row and what is allowed."""

import re

import pytest
from curve_texts import BIAS, FREE, PERCENT, SHEAR, SHEET, UNIAXIAL, WIDENED, folder

from fabric_fenicsx.identification import curves as data
from fabric_fenicsx.runtime.errors import InputError

NARROW = "allowed is at most 0, free sides narrow (is its sign turned?)"
CASES = [
    (UNIAXIAL, "# test: uniaxial_a\n", "", "no line `# test: ...` states the test; allowed are"),
    (UNIAXIAL, "uniaxial_a", "uniaxal_a", "row 2: test 'uniaxal_a' is unknown (did you mean uniax"),
    (UNIAXIAL, "sigma_a [MPa]", "eps_b [%]", "row 5: lateral: held says that eps_b is 0, but"),
    (UNIAXIAL, "sigma_a [MPa]", "stress [MPa]", "row 5: column 'stress' is unknown; allowed are"),
    (UNIAXIAL, "sigma_a [MPa]", "sigma_a", "row 5: the column sigma_a has no unit; allowed is"),
    (UNIAXIAL, "1.5,22.8", "0.9,22.8", "row 9: eps_a is 0.009 after 0.01; allowed is to rise or"),
    (UNIAXIAL, "2.5,41.1\n", "", "row 10: the file ends after 4 points; allowed is 5 or more"),
    (FREE, "sigma_a [MPa]", "F [N]", "row 5: the column F needs the strip's width; allowed is"),
    (FREE, "41.1", "-410.1", "row 11: sigma_a is -410.1 MPa; allowed is at least 0, of the test"),
    (FREE, "41.1", "4.1", "row 11: sigma_a has fallen to 13 % of its value in row 10; allowed"),
    (PERCENT, "", "", "row 9: eps_a reaches 0.03 % only; allowed is 0.05 % or more (is the unit -"),
    (WIDENED, "", "", f"row 8: eps_a is 0.1; {NARROW}"),
    (re.sub(r"0\.\d+", "0", SHEAR), "", "", "row 3: F_sh is 0 in every row, so there is nothing"),
    (FREE, "sigma_a [MPa]", "displacement [mm]", "row 5: both columns eps_a and displacement"),
    (BIAS, "gamma [deg]", "exx [%]", "the column eyy is missing"),
    (BIAS, "gamma [deg]", "exx [%]", "the strain of exx is not stated; allowed is `# strain: gre"),
    (BIAS, "11.5 cm", "15 cm", "height is 230 mm and width 150 mm; allowed is a height of 2"),
]


@pytest.mark.parametrize(("text", "old", "new", "sentence"), CASES)
def test_bad_files(tmp_path, text, old, new, sentence):
    assert old in text
    path = folder(tmp_path, bad=text.replace(old, new, 1)) / "bad.csv"
    with pytest.raises(
        InputError, match=re.escape(f"{path}: ") + ".*" + re.escape(sentence)
    ) as error:
        data.read(tmp_path)
    assert "\n" not in str(error.value)


BALANCED, WEIGHT = "balanced = true", "areal_weight_g_per_m2 = 700\nbalanced"


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("balanced", WEIGHT, "density and areal_weight are both given; allowed is one"),
        (BALANCED, f"{BALANCED}\n[assumed]\np_min = 2", "assumed.p_min is 2; allowed is a number"),
        (BALANCED, f"{BALANCED}\n[assumed.warp]\np_min = 1", "assumed.warp is given for a"),
    ],
)
def test_bad_sheets(tmp_path, old, new, sentence):
    path = folder(tmp_path, SHEET.replace(old, new, 1), warp=UNIAXIAL) / "sheet.toml"
    with pytest.raises(InputError, match=re.escape(f"{path}: ") + ".*" + re.escape(sentence)):
        data.read(tmp_path)


def test_a_copy_is_no_second_test(tmp_path):
    with pytest.raises(InputError, match="warp2.csv has the values of warp.csv, row by row"):
        data.read(folder(tmp_path, warp=UNIAXIAL, warp2=UNIAXIAL))


def test_bad_folders(tmp_path):
    with pytest.raises(InputError, match=r"sheet.toml: cannot be read \(No such file"):
        data.read(tmp_path)
    with pytest.raises(InputError, match=r"has no \*.csv"):
        data.read(folder(tmp_path))
