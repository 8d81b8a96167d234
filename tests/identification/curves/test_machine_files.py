"""Files as testing machines write them: what is read all the same, and what is refused."""

import re

import numpy as np
import pytest
from curve_texts import BIAS, SHEET, folder
from synthetic_curves import bias_displacement

from fabric_fenicsx.core.errors import InputError
from fabric_fenicsx.identification import curves as data

KEYS = "# test: bias_extension\n# height: 230 mm\n# width: 115 mm\n"
ROWS = [(2.5, 0.29), (6, 0.95), (12, 2.1), (17.25, 1058.5), (21, 1450.25)]
HEAD = "displacement [mm];F [N]\n"


def rows(form, separator=";", decimal="."):
    """The rows of numbers of this form."""
    return "\n".join(
        separator.join(format(v, form).replace(".", decimal) for v in row) for row in ROWS
    )


POINT, COMMA = rows(".3f"), rows(".3f", decimal=",")
FILES = {
    "decimal commas": KEYS + HEAD + COMMA,
    "decimal commas in quotes": KEYS
    + HEAD.replace(";", ",")
    + re.sub(r"([\d,]+);([\d,]+)", r'"\1","\2"', COMMA),
    "tabs": (KEYS + HEAD + POINT).replace(";", "\t"),
    "blanks": KEYS + "displacement [mm]  F [N]\n" + POINT.replace(";", "  "),
    "exponents": KEYS + HEAD + rows("+.6E", decimal=","),
    "a row of units": KEYS + "displacement;F\nmm;N\n" + COMMA,
    "lines above": "Prüfer;Müller\nDatum;12.03.2024 09:41\nv;2;mm/min\n\n"
    + KEYS
    + "Standardweg;Standardkraft\nmm;N\n"
    + COMMA,
    "a spreadsheet's first line": "sep=;\n" + KEYS + HEAD + COMMA,
}


def read(path, content, sheet=SHEET):
    folder(path, sheet)
    (path / "bias.csv").write_bytes(content)
    return data.read(path)[1][0]


def check(curve, remarks=0):
    moved = [row[0] for row in ROWS]
    assert bias_displacement(curve.strains[:, 2], 230, 115) == pytest.approx(moved, rel=1e-9)
    assert curve.responses[0].values == pytest.approx([row[1] for row in ROWS], rel=1e-12)
    assert len(curve.remarks) == remarks


@pytest.mark.parametrize("text", FILES.values(), ids=FILES.keys())
def test_a_file_is_read_as_it_was_written(tmp_path, text):
    for encoding in ("utf-8-sig", "cp1252", "utf-16"):
        check(read(tmp_path, text.encode(encoding)))


MACHINE = KEYS + HEAD
REFUSED = {
    "1,5;1.234\n3;2.5\n": "row 5: F is '1.234', row 6: F is '2.5'; expected a finite number",
    "2;1,200\n3;2,100\n": "row 5: F is '1,200', which may mean 1.200 or 1200; expected",
    "1,5;1.058,5\n": "row 5: F is '1.058,5'; expected a finite number, as 1058,5",
    "mm;kN\n" + COMMA: "row 5: the unit of F is kN, and N in the header",
    POINT.replace(";", " mm;"): "row 5: displacement is '2.500 mm', row 6: displ",
    "2;1\n2;2\n2;3\n2;4\n2;5\n": "row 9: displacement is 2 mm in every row",
    "2;1\n4;2\n6;3\n3;1\n4;2\n6;3\n10;5\n": "row 8: displacement is ",
}
UNREADABLE = {
    b"": "bias.csv: cannot be read as text (it is empty",
    b"PK\x03\x04": "it is a workbook; save its sheet as CSV",
    (MACHINE + COMMA).encode("utf-16-le"): "not text in UTF-8); expected CSV in UTF-8, or in UTF",
    (KEYS + "Traverse [mm];Kanal 1 [N]\n" + COMMA).encode(): "row 4: columns 'Traverse', 'Kanal 1' "
    "are unknown; expected",
}
UNREADABLE |= {(MACHINE + rows).encode(): words for rows, words in REFUSED.items()}


@pytest.mark.parametrize("content", UNREADABLE)
def test_what_cannot_be_read_is_refused_in_one_sentence(tmp_path, content):
    with pytest.raises(InputError, match=re.escape(UNREADABLE[content])):
        read(tmp_path, content)


def test_the_sheet_says_how_numbers_are_written_and_what_columns_and_files_are(tmp_path):
    sheet = SHEET + '[csv]\nencoding = "utf-16-le"\ndecimal = ","\ndelimiter = "\\t"\n'
    rows = "".join(f"{k}\t{k},234\n" for k in range(1, 6))
    text = (KEYS + HEAD.replace(";", "\t") + rows).encode("utf-16-le")
    assert read(tmp_path, text, sheet).responses[0].values[0] == 1.234
    stated = '[columns]\nFahrweg = "displacement"\nK = "F [N]"\n[tests."bias.csv"]\n'
    stated += 'test = "bias_extension"\nheight = "230 mm"\nwidth = "11,5 cm"\n'
    text = "Probe;A 1\nFahrweg [mm];K\n" + COMMA
    check(read(tmp_path, text.encode(), SHEET + stated))


def test_files_of_other_names_are_read_if_the_sheet_names_them(tmp_path):
    folder(tmp_path, SHEET + '[tests."bias.TRA"]\nnoise = "2 % of maximum"\n')
    (tmp_path / "bias.TRA").write_text(KEYS + HEAD + COMMA)
    check(data.read(tmp_path)[1][0])
    (tmp_path / "bias.TRA").rename(tmp_path / "bias.tsv")
    with pytest.raises(InputError, match=r"tests.'bias.TRA' is no file; expected bias.tsv"):
        data.read(tmp_path)


def test_of_columns_of_one_name_the_sheet_says_which_counts(tmp_path):
    text = KEYS + "Weg [mm];Standardweg [mm];F [N]\n" + COMMA.replace("\n", "\n9,5;")
    text = text.replace("F [N]\n", "F [N]\n9,5;")
    with pytest.raises(InputError, match="row 4: the column displacement is repeated"):
        read(tmp_path, text.encode())
    curve = read(tmp_path, text.encode(), SHEET + '[columns]\nStandardweg = "displacement"\n')
    assert curve.remarks == ("column 'Weg' is ignored; see [columns] of sheet.toml",)
    assert curve.responses[0].values.tolist() == [row[1] for row in ROWS]


def test_of_a_loop_the_first_loading_branch_is_fitted(tmp_path):
    up = [(2, 1), (4, 2), (6, 3), (8, 4), (10, 5)]
    text = KEYS + HEAD + "".join(f"{x};{f}\n" for x, f in up + [(5, 2), (0, 0)] + up)
    curve = read(tmp_path, text.encode())
    assert curve.responses[0].values.tolist() == [1, 2, 3, 4, 5]
    words = "displacement reverses after row 9: of the loop the loading branch is fitted"
    assert curve.remarks == (words + ", rows 5 to 9",)


@pytest.mark.parametrize(
    "back, last", [([7, 6, 5, 4], 4), ([7, 6, 5], None), ([7, 5, 4, 3, 6, 1], 3)]
)
def test_of_a_loop_in_shear_five_points_back_tell_friction(tmp_path, back, last):
    """Down to the next turn, from a stated slack on."""
    rows = "".join(f"{g},{g / 10}\n" for g in [1, 2, 3, 4, 5, 6, 7, 8, *back])
    text = f"# test: shear\n# slack: 0.5 deg\ngamma [deg],tau [MPa]\n{rows}"
    (curve,) = data.read(folder(tmp_path, loop=text))[1]
    assert np.degrees(curve.strains[:, 2]) == pytest.approx(np.arange(1, 9) - 0.5)
    assert (curve.back is None) == (last is None)
    if last:
        assert np.degrees(curve.back[0][[0, -1]]) == pytest.approx([7.5, last - 0.5])


@pytest.mark.parametrize("degrees, told", [(29.8, False), (30.2, True)])
def test_angles_by_the_displacement_are_doubted_from_30_deg_on(tmp_path, degrees, told):
    x = bias_displacement(np.radians(degrees), 230, 115) * np.linspace(0.2, 1, 5)
    rows = "".join(f"{a:.6f};{a:.6f}\n" for a in x)
    (words,) = [*data.curve_warnings([read(tmp_path, (KEYS + HEAD + rows).encode())])] or [""]
    assert ("shear angles are above 30 deg" in words) == told


@pytest.mark.parametrize(
    "old, new, words, left",
    [
        ("0.500", "-0.010", "row 3 left out, because noise puts gamma beyond 0 there", 49),
        ("12.000", "11.500", "gamma does not increase in row 26; treated as scatter", 50),
        ("12.000", "11.400", "in row 26; treated as scatter", 50),
        ("0.500", "0.000", "", 50),
    ],
)
def test_noise_of_what_runs_is_read_and_told(tmp_path, old, new, words, left):
    rows = "".join(f"{k / 2:.3f},{k}\n" for k in range(1, 51))
    text = f"# test: shear\ngamma [deg],tau [MPa]\n{rows}".replace(f"\n{old},", f"\n{new},")
    (curve,) = data.read(folder(tmp_path, test=text))[1]
    assert len(curve.rows) == left and words in "".join(curve.remarks)
    assert bool(words) == bool(curve.remarks)


def test_of_two_tests_side_by_side_the_first_is_read_unless_told_otherwise(tmp_path):
    head = '"Name","1 _ 1","","1 _ 2",""\n"Force","Stroke","Force","Stroke"\n"N","mm","N","mm"\n'
    beside = "".join(f'"{f}","{x}","{2 * f}","{x}"\n' for x, f in ROWS) + '"","","9","30"\n'
    curve = read(tmp_path, (KEYS + head + beside).encode())
    assert curve.responses[0].values.tolist() == [row[1] for row in ROWS]
    (first, second) = curve.remarks
    assert first == "column 'Force 2' is ignored; see [columns] of sheet.toml"
    other = SHEET + '[columns]\n"Force 2" = "F"\n"Stroke 2" = "displacement"\n'
    curve = read(tmp_path, (KEYS + head + beside).encode(), other)
    assert curve.responses[0].values.tolist() == [*(2 * row[1] for row in ROWS), 9]


def strip(moved, force, more=""):
    head = f"# test: uniaxial_a\n# lateral: free\n# length: 200 mm\n# width: 50 mm\n{more}"
    return head + "displacement [mm],F [N]\n" + "".join(f"{x},{f}\n" for x, f in zip(moved, force))


def test_strain_and_force_count_from_a_stated_slack_and_zero(tmp_path):
    x = np.linspace(0.2, 5, 25).round(1)
    pulled = strip(x, 500 * x - 40, "# slack = 0,1 cm\n# zero -40 N\n# speed: 5 mm/min\n")
    (curve,) = data.read(folder(tmp_path, strip=pulled))[1]
    assert curve.remarks == ("the line 'speed' is ignored",)
    assert curve.strains[[0, -1], 0] == pytest.approx([0.001, 0.02])
    assert curve.rows[0] == 14
    assert curve.responses[0].values[-1] == pytest.approx(2500 / 50 / 1.2)
    bias = BIAS.replace("# width", "# slack: 4 deg\n# width")
    (tmp_path / "strip.csv").write_text(bias)
    (curve,) = data.read(tmp_path)[1]
    assert curve.strains[0, 2] == pytest.approx(np.radians(6))


@pytest.mark.parametrize("power, slack", [(1, 3.1), (1, 0.0), (2, 0.0)])
@pytest.mark.parametrize("zero", [0.0, -90.0])
def test_slack_and_zero_that_nobody_stated_are_named(tmp_path, power, slack, zero):
    x = np.linspace(0, 40, 81)
    force = 100 * np.maximum(x - slack, 0) ** power / 40 ** (power - 1) + zero
    remarks = read(tmp_path, strip(x, force).encode()).remarks
    expected = ["state `# zero: -90 N`"] * (zero != 0)
    expected += ["state it as `# slack: 3.1 mm` or less"] * (slack > 0)
    assert [text[text.index("state") :] for text in remarks] == expected
