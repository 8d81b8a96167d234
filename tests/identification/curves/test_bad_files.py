"""What wrong files of test curves say: file, row and what is allowed."""

import re

import numpy as np
import pytest
from curve_texts import BIAS, FREE, SHEET, UNIAXIAL, WIDENED, folder

from fabric_fenicsx.core.errors import InputError
from fabric_fenicsx.identification import curves as data

NARROW = "allowed is at most 0, free sides narrow (is its sign turned?)"
CASES = [
    (UNIAXIAL, "# test: uniaxial_a\n", "", "no line `# test: ...` states the test; allowed are"),
    (UNIAXIAL, "uniaxial_a", "uniaxal_a", "row 2: test 'uniaxal_a' is unknown (did you mean uniax"),
    (UNIAXIAL, "sigma_a [MPa]", "sigma_a", "row 5: the column sigma_a has no unit; allowed is"),
    (UNIAXIAL, "2.5,41.1\n", "", "row 10: the file ends after 4 points; allowed is 5 or more"),
    (FREE, "sigma_a [MPa]", "F [N]", "row 5: the column F needs the strip's width; allowed is"),
    (FREE, "41.1", "-410.1", "row 11: sigma_a is -410.1 MPa; allowed is at least 0, of the test"),
    (WIDENED, "", "", f"row 8: eps_a is 0.1; {NARROW}"),
    (BIAS, "gamma [deg]", "exx [%]", "the strain of exx is not stated; allowed is `# strain: gre"),
    (BIAS, "11.5 cm", "15 cm", "height is 230 mm and width 150 mm; allowed is a height of 2"),
]


@pytest.mark.parametrize(("text", "old", "new", "sentence"), CASES)
def test_bad_files(tmp_path, text, old, new, sentence):
    assert old in text
    path = folder(tmp_path, bad=text.replace(old, new, 1)) / "bad.csv"
    with pytest.raises(InputError, match=re.escape(f"{path}: ") + ".*" + re.escape(sentence)):
        data.read(tmp_path)


PULL = "uniaxial_a", "# lateral: held\n", "eps_a [%],sigma_a [MPa]"


def limit(values, x, test, keys, columns):
    rows = "".join(f"{a:.9g},{b:.9g}\n" for a, b in zip(x, values))
    return f"# test: {test}\n{keys}{columns}\n{rows}"


X = np.arange(1.0, 7)
TURNED = "shear", "", "gamma [deg],tau [MPa]"
BRANCH = np.arange(9.0)
LIMITS = {  # text of a file by a number: the last that is allowed, and the first that is not
    "strain": (lambda v: (X, X / 6 * v, *PULL), 49.9, 50.1, "within +-0.5"),
    "shear angle": (lambda v: (X, X / 6 * v, *TURNED), 84.9, 85.1, "within +-1.48"),
    "strain of a test": (lambda v: (X, X / 6 * v, *PULL), 0.051, 0.049, "0.05 % or more"),
    "angle of a test": (lambda v: (X, X / 6 * v, *TURNED), 1.61, 1.59, "1.6 deg or"),
    "fall": (lambda v: ([1, 2, 4, 8, 10, v], X, *PULL), 5.1, 4.9, "has fallen to 49 %"),
    "before strain": (lambda v: ([v, *X[1:] * 2], X - 1, *PULL), 2.3, 2.5, "before anything is"),
    "steps back": (lambda v: (X, [0, 2, 4, 5, 5 - v, 10], *PULL), 0.09, 0.11, "to rise"),
    "branch": (lambda v: (BRANCH, [1, 3, 6, 8, 9, v, 5, 2, 10.5], *PULL), 10.45, 10.35, "to rise"),
}


@pytest.mark.parametrize("kind", LIMITS)
def test_just_below_and_above_a_limit(tmp_path, kind):
    text, allowed, refused, words = LIMITS[kind]
    data.read(folder(tmp_path, t=limit(*text(allowed))))
    with pytest.raises(InputError, match=re.escape(words)):
        data.read(folder(tmp_path, t=limit(*text(refused))))


def test_bad_sheets_and_folders(tmp_path):
    for words, more in (
        (r"sheet.toml: cannot be read \(No such file", None),
        (r"has no \*.csv", {}),
        ("warp2.csv has the values of warp.csv", {"warp": UNIAXIAL, "warp2": UNIAXIAL}),
        ("are both given", {"sheet": f"areal_weight_g_per_m2 = 700\n{SHEET}"}),
        ("assumed.p_min is 2; allowed is a", {"sheet": f"{SHEET}[assumed]\np_min = 2"}),
    ):
        if more is not None:
            folder(tmp_path, **more)
        with pytest.raises(InputError, match=words):
            data.read(tmp_path)
