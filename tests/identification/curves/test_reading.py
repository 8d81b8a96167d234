"""Files of test curves: what is read of them, and what wrong ones say."""

import math
import re

import numpy as np
import pytest
from curve_texts import BIAS, FREE, SHEAR, SHEET, UNIAXIAL, WIDENED, folder
from scipy.integrate import trapezoid

from fabric_fenicsx.core.errors import InputError
from fabric_fenicsx.identification import curves as data
from fabric_fenicsx.identification.curves import bias_normalised
from fabric_fenicsx.identification.curves.model import bias_angle, response
from fabric_fenicsx.material.homogeneous import nominal
from fabric_fenicsx.material.kernel import evaluate
from fabric_fenicsx.material.presets import PRESETS

PULLED = (0.5, 6.9), (1, 14.5), (1.5, 22.8), (2, 31.6), (2.5, 41.1)  # of UNIAXIAL, % and MPa


def test_a_file_is_read(tmp_path):
    sheet, (curve,) = data.read(folder(tmp_path, warp=UNIAXIAL))
    assert sheet == data.Sheet("x", 1.2, 0.6, True)
    assert (curve.file, curve.test, curve.free) == ("warp.csv", "uniaxial_a", None)
    assert (curve.noise, curve.abscissa) == (("maximum", 0.02), 0)
    assert curve.strains == pytest.approx(np.outer([0.005, 0.01, 0.015, 0.02, 0.025], [1, 0, 0]))
    assert curve.rows.tolist() == [6, 7, 9, 10, 11]
    assert curve.responses[0].values.tolist() == [6.9, 14.5, 22.8, 31.6, 41.1]


def test_areal_weight_is_a_density_and_values_may_be_assumed(tmp_path):
    text = SHEET.replace("density_g_per_cm3 = 0.6", "areal_weight_g_per_m2 = 743")
    sheet = data.read_sheet(folder(tmp_path, text) / "sheet.toml")
    assert sheet.density == pytest.approx(0.743 / 1.2, rel=1e-14) and sheet.areal_weight == 743
    text = text.replace("_g_per_m2 = 743", " = 0.743") + '[units]\nareal_weight = "kg/m2"\n'
    assert data.read_sheet(folder(tmp_path, text) / "sheet.toml") == sheet
    text = SHEET.replace("true", "false") + "[assumed]\nd_kPa = 900\n[assumed.weft]\nd_MPa = 2\n"
    sheet = data.read_sheet(folder(tmp_path, text) / "sheet.toml")
    assert sheet.assumed == {"d": 0.9, "weft.d": 2.0}


def test_forces_per_width_are_divided_by_the_thickness(tmp_path):
    shear = SHEAR.replace("F_sh [N/mm]", "tau [MPa]")
    for text, unit, factor in ((FREE, "N/mm", 1.2), (shear, "N/m", 1200.0)):
        text = text.replace("2 % of maximum", "0.3 MPa")
        scaled = re.sub(r",([\d.]+)$", lambda m: f",{float(m[1]) * factor:.6g}", text, flags=re.M)
        scaled = scaled.replace("[MPa]", f"[{unit}]").replace("0.3 MPa", f"{0.3 * factor} {unit}")
        folder(tmp_path, first=text, second=scaled)
        (one,), (two,) = (data.read(tmp_path / f"{k}.csv")[1] for k in ("first", "second"))
        assert two.responses[0].values == pytest.approx(one.responses[0].values, rel=1e-5)
        assert two.responses[0].unit == "MPa"
        assert one.noise is None or two.noise == ("absolute", pytest.approx(0.3))


def test_what_a_machine_writes_is_strain_stress_and_shear_angle(tmp_path):
    """Of a strip 200 mm long and 50 mm wide, and of a bias strip of 230 x 115 mm."""
    folder(tmp_path, plain=FREE)
    head = "# length: 20 cm\n# width: 50 mm\ndisplacement [cm],F [kN]\n"
    raw = "".join(f"{0.2 * e:.6g},{0.06 * s:.6g}\n" for e, s in PULLED)
    (tmp_path / "raw.csv").write_text(FREE.split("eps_a")[0] + head + raw)
    (one,), (two,) = (data.read(tmp_path / f"{name}.csv")[1] for name in ("plain", "raw"))
    assert two.strains == pytest.approx(one.strains)
    assert two.responses[0].values == pytest.approx(one.responses[0].values)
    assert (two.responses[0].column, two.keys) == ("sigma_a", {"length": 200.0, "width": 50.0})
    gamma = np.radians([10, 20, 30, 35, 40])
    moved = 115 * (np.sqrt(2) * np.cos(np.pi / 4 - gamma / 2) - 1)
    assert bias_angle(moved, 230, 115) == pytest.approx(gamma)


def test_a_strip_with_free_sides_needs_no_width(tmp_path):
    _, (curve,) = data.read(folder(tmp_path, strip=FREE))
    assert curve.free == 0 and [r.column for r in curve.responses] == ["sigma_a"]
    wider = re.sub(r"(?m)^(\d.*)$", r"\1,-2", FREE).replace("[MPa]", "[MPa],eps_b [%]")
    (tmp_path / "strip.csv").write_text(wider)
    (curve,) = data.read(tmp_path)[1]
    assert curve.free == 0 and [r.column for r in curve.responses] == ["sigma_a", "eps_b"]


X = np.linspace(1, 40, 20)  # mm


def photographed(columns, *values, test="bias_extension", keys=""):
    """A test with columns of images, of a force that counts for nothing."""
    frame = "# frame_length: 300 mm\n# fabric_length: 200 mm\n"
    sizes = {"bias_extension": "# height: 300 mm\n# width: 100 mm\n", "shear": ""}.get(test, frame)
    rows = "".join(",".join(f"{each:.17g}" for each in row) + "\n" for row in zip(*values, X))
    force = "F [N]" if sizes else "tau [MPa]"
    return f"# test: {test}\n{sizes}{keys}{columns},{force}\n{rows}"


MEASURES = {"green": lambda u: (u * u - 1) / 2, "hencky": np.log, "biot": lambda u: u - 1}


@pytest.mark.parametrize("measure", MEASURES)
def test_strains_of_images_become_shear_angles(tmp_path, measure):
    """Of stretches along and across the bisector of the yarns."""
    g, of = bias_angle(X, 300, 100), MEASURES[measure]
    along, across = (of(np.sqrt(1 + sign * np.sin(g))) for sign in (1, -1))
    head, keys = "displacement [mm],exx [-],Eyy [-],exy [-]", f"# strain: {measure}\n"
    bias = photographed(head, X, across, along, 0 * X, keys=keys)
    (curve,) = data.read(folder(tmp_path, test=bias))[1]
    assert curve.strains[:, 2] == pytest.approx(g, abs=1e-12)
    assert not (curve.is_raw or curve.remarks)
    mean, half = (along + across) / 2, (along - across) / 2  # along yarns
    names = "exx [-],eyy [-],exy [-]"
    frame = photographed(names, along, across, 0 * X, test="picture_frame", keys=keys)
    (curve,) = data.read(folder(tmp_path, test=frame))[1]
    assert curve.strains[:, 2] == pytest.approx(g, abs=1e-12)
    shear = photographed(names, mean, mean, -half, test="shear", keys=keys)
    (curve,) = data.read(folder(tmp_path, test=shear))[1]
    assert curve.strains[:, 2] == pytest.approx(g, abs=1e-12)


@pytest.mark.parametrize("share, told", [(0.71, 0), (0.69, 1)])
def test_an_angle_that_does_not_fit_the_displacement_is_told(tmp_path, share, told):
    g = share * np.degrees(bias_angle(X, 300, 100))
    text = photographed("displacement [mm],gamma [deg]", X, g)
    (curve,) = data.read(folder(tmp_path, test=text))[1]
    assert curve.strains[-1, 2] == pytest.approx(np.radians(g[-1]))
    assert sum("it as the shear strain of a tensor" in each for each in curve.remarks) == told


KOMEILI = PRESETS["komeili"]


def tau(g):
    """Shear stress [MPa] by the angle [rad], of Table 1."""
    return (0.02506 - 0.18679 * g + 0.56239 * g**2) * g


def test_shear_force_is_the_part_of_the_traction_along_the_yarn():
    """F_sh / t = S12 of the kernel at unstrained yarns, so tau t = F_sh cos(gamma)."""
    g = np.linspace(0.1, 1.2, 12)
    C = np.stack([np.ones(12), np.sin(g), np.sin(g), np.ones(12)], -1).reshape(-1, 2, 2)
    found = response("F_sh", tau(g), g, "shear", {}, 1.2)
    S = evaluate(KOMEILI, cauchy_green=C).S
    assert found.gain * tau(g) / 1.2 == pytest.approx(S[:, 0, 1], rel=1e-12)
    assert nominal(KOMEILI, np.outer(g, [0, 0, 1]))[:, 2] == pytest.approx(tau(g), rel=1e-12)


def test_forces_do_the_work_that_the_fabric_stores():
    """The integral of the crosshead force over its way is the energy of all zones."""
    g = np.linspace(0, math.radians(50), 20001)
    t, W, H, frame, fabric = 1.2, 115.0, 230.0, 200.0, 140.0

    def energy(g):
        return 0.02506 * g**2 / 2 - 0.18679 * g**3 / 3 + 0.56239 * g**4 / 4

    bias = response("F", g, g, "bias_extension", {"height": H, "width": W}, t)
    force = bias.gain * tau(g) + bias.half * tau(g / 2)
    way = (H - W) * (np.cos(g / 2) + np.sin(g / 2) - 1)
    stored = t * (W * (2 * H - 3 * W) / 2 * energy(g[-1]) + W**2 * energy(g[-1] / 2))
    assert trapezoid(force, way) == pytest.approx(stored, rel=1e-7)
    lengths = {"frame_length": frame, "fabric_length": fabric}
    force = response("F", g, g, "picture_frame", lengths, t).gain * tau(g)
    way = 2 * frame * np.cos(math.pi / 4 - g / 2)
    assert trapezoid(force, way) == pytest.approx(t * fabric**2 * energy(g[-1]), rel=1e-7)


def test_normalisation_of_a_bias_test():
    """The formula of Cao et al. gives F_sh = tau t / cos(gamma) of the force of the law."""
    g = np.linspace(0.01, math.radians(50), 400)
    for H, W in ((230.0, 115.0), (450.0, 150.0)):
        bias = response("F", g, g, "bias_extension", {"height": H, "width": W}, 1.2)
        force = bias.gain * tau(g) + bias.half * tau(g / 2)
        found = bias_normalised(g, force, H, W)
        # what is left is the interpolation at gamma / 2
        assert found == pytest.approx(1.2 * tau(g) / np.cos(g), rel=2e-4, abs=5e-5 * tau(g[-1]))


NARROW = "expected at most 0, free sides narrow (is its sign wrong?)"
CASES = [
    (UNIAXIAL, "# test: uniaxial_a\n", "", "no line `# test: ...` states the test; expected"),
    (UNIAXIAL, "2.5,41.1\n", "", "row 10: 4 points remain to be fitted; expected 5 or"),
    (FREE, "sigma_a [MPa]", "F [N]", "row 5: the column F needs the strip's width; expected"),
    (FREE, "41.1", "-410.1", "row 11: sigma_a is -410.1 MPa; expected at least 0, of the test"),
    (WIDENED, "", "", f"row 8: eps_a is 0.1; {NARROW}"),
    (BIAS, "gamma [deg]", "exx [%]", "the strain of exx is not stated; expected `# strain: gre"),
    (BIAS, "# width", "# preload: 1 N\n# width", "row 3: the key preload is unknown; expected"),
    (BIAS, "# width", "# give = 1 mm/N\n# width", "row 3: the key give is unknown; expected"),
    (BIAS, "# width", "# slack: 1 rad\n# width", "row 5: 0 points remain to be fitted; expected"),
    (BIAS, "# width", "# zero: 9 N\n# width", "row 10: F is -4 N; expected at least 0, of"),
    (BIAS, "40,5", "40,9.9e37", "row 9: F is 9.9e+37 N; expected within +-1e9"),
    (BIAS, "11.5 cm", "15 cm", "height is 230 mm and width 150 mm; expected a height of 2"),
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


UP = np.arange(1.0, 7)
TURNED = "shear", "", "gamma [deg],tau [MPa]"
TURNS = np.arange(10.0)
LIMITS = {  # text of a file by a number: the last that is allowed, and the first that is not
    "strain": (lambda v: (UP, UP / 6 * v, *PULL), 49.9, 50.1, "within +-0.5"),
    "shear angle": (lambda v: (UP, UP / 6 * v, *TURNED), 84.9, 85.1, "within +-1.48"),
    "strain of a test": (lambda v: (UP, UP / 6 * v, *PULL), 0.051, 0.049, "0.05 % or more"),
    "angle of a test": (lambda v: (UP, UP / 6 * v, *TURNED), 1.61, 1.59, "1.6 deg or"),
    "fall": (lambda v: ([1, 2, 4, 8, 10, v], UP, *PULL), 5.1, 4.9, "has fallen to 49 %"),
    "before strain": (lambda v: ([v, *UP[1:] * 2], UP - 1, *PULL), 2.3, 2.5, "at the start"),
    "steps back": (lambda v: (UP, [0, 2, 4, 5, 5 - v, 10], *PULL), 0.09, 0.11, "to rise"),
    "cycles": (lambda v: (TURNS, [1, 3, 6, 9, v, 5, 0, 10.5, 4, 0], *PULL), 10.45, 10.35, "(keep"),
    "thousands": (lambda v: ([1, v, 1.185, 30, 31, 41], UP, *PULL), 37, 38, "1.185 or 1185"),
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
    ):
        if more is not None:
            folder(tmp_path, **more)
        with pytest.raises(InputError, match=words):
            data.read(tmp_path)
