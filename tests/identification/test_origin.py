"""Slack and the load cell's zero: found, told where nothing tells them, and in the intervals."""

import numpy as np
import pytest
from curve_texts import SHEET, folder

from fabric_fenicsx.identification import curves as data
from fabric_fenicsx.identification import identify
from fabric_fenicsx.identification.curves.forces import bias_angle, response

LAW = np.array([0.08, -0.15, 0.25])  # s1, s2, s3 [MPa]
SIZES = {
    "bias_extension": {"height": 300, "width": 100},
    "picture_frame": {"frame_length": 140, "fabric_length": 100},
}


def sheared(kind, x, slack=0.0, zero=0.0, noise=0.0, seed=1, law=LAW, more=""):
    """A test to displacements x [mm], or angles [deg], of which the law begins at a slack."""
    loaded = np.maximum(x - slack, 0)
    g = bias_angle(loaded, 300, 100) if kind == "bias_extension" else np.radians(loaded)
    by = response("F", g, g, kind, SIZES[kind], 1.2)
    half = 0 if by.half is None else by.half
    force = sum(s * (by.gain * g**k + half * (g / 2) ** k) for k, s in enumerate(law, 1))
    force = force + zero + noise * force.max() * np.random.default_rng(seed).normal(size=len(x))
    keys = "".join(f"# {key}: {value} mm\n" for key, value in SIZES[kind].items())
    name = "displacement [mm]" if kind == "bias_extension" else "gamma [deg]"
    rows = "".join(f"{a:.4f},{b:.5f}\n" for a, b in zip(x, force))
    return f"# test: {kind}\n{more}{keys}{name},F [N]\n{rows}"


def fit(tmp_path, text):
    return identify(*data.read(folder(tmp_path, SHEET, t=text)))


@pytest.mark.parametrize("kind, end", [("bias_extension", 50.0), ("picture_frame", 40.0)])
@pytest.mark.parametrize("slack, zero", [(0.0, 0.0), (2.0, 0.4)])
def test_slack_and_zero_are_fitted(tmp_path, kind, end, slack, zero):
    x = np.linspace(0, end, 60)
    found = fit(tmp_path, sheared(kind, x, slack, zero, 0.003))
    for number, true in zip(found.determined.values(), LAW):
        assert number.interval[0] <= true <= number.interval[1]
    if not slack:  # what may be 0 is taken as 0
        assert not found.origins
        return
    loose, tare = found.origins["slack of t.csv"], found.origins["zero of t.csv"]
    for number, true in ((loose, slack), (tare, zero)):
        assert number.interval[0] <= true <= number.interval[1]
    assert loose.value == pytest.approx(slack, abs=1.0) and tare.value == pytest.approx(zero, abs=1)
    assert loose.unit == ("mm" if kind == "bias_extension" else "deg") and tare.unit == "N"
    assert "zero of t.csv was fitted, 95 % interval" in "\n".join(found.remarks())


def test_a_law_that_is_off_at_the_peak_does_not_move_the_beginning(tmp_path):
    x = np.linspace(0, 48, 70)
    law = [0.14, -0.4, 0.5, *[0] * 6, 30]  # yarns that lock: more than half of the peak
    text = sheared("bias_extension", x, 3.0, -0.3, 0.002, law=law)
    found = fit(tmp_path, text).origins
    low, high = found["slack of t.csv"].interval
    assert low <= 3 <= high and found["slack of t.csv"].value == pytest.approx(3, abs=0.2)
    assert found["zero of t.csv"].value == pytest.approx(-0.3, abs=0.02)


def test_intervals_hold_with_unknown_slack_and_zero(tmp_path):
    random, inside = np.random.default_rng(7), np.zeros(3, int)
    for seed in range(12):
        slack, zero = random.uniform(0, 3), random.uniform(-0.5, 0.5)
        x = np.linspace(0, 50, 60)
        found = fit(tmp_path, sheared("bias_extension", x, slack, zero, 0.005, seed))
        for k, number in enumerate(found.determined.values()):
            inside[k] += number.interval[0] <= LAW[k] <= number.interval[1]
    assert inside.min() >= 10  # less by chance once in 500 runs


def test_a_strip_with_slack(tmp_path):
    x = np.linspace(0, 6, 40)
    loaded = np.maximum(x - 1.3, 0) / 200
    force = 50 * 1.2 * (3 * 4130 * loaded + 2 * 667.5) * loaded - 20
    rows = "".join(f"{a:.4f},{b:.4f}\n" for a, b in zip(x, force))
    keys = "# test: uniaxial_a\n# lateral: held\n# length: 200 mm\n# width: 50 mm\n"
    found = fit(tmp_path, keys + "displacement [mm],F [N]\n" + rows)
    assert found.origins["slack of t.csv"].value == pytest.approx(1.3, abs=0.02)
    assert found.origins["zero of t.csv"].value == pytest.approx(-20, abs=0.1)
    assert found.fabric.warp.a == pytest.approx(4130, rel=0.02)


def test_what_tells_no_origin_is_said(tmp_path):
    late = fit(tmp_path, sheared("bias_extension", np.linspace(9, 50, 30)))
    assert not late.origins
    words = "t.csv: nothing tells its slack and zero, taken as 0, as it begins at 18 % of its way"
    assert any(w.startswith(words) for w in late.warnings)
    few = fit(tmp_path, sheared("bias_extension", np.linspace(0, 50, 11)))
    assert any("as it has 11 points, and 12 would tell; state `# slack" in w for w in few.warnings)
    stated = fit(
        tmp_path,
        sheared("bias_extension", np.linspace(9, 50, 30), more="# slack: 0 mm\n# zero: 0 N\n"),
    )
    assert not stated.origins and not any("nothing tells" in w for w in stated.warnings)
    assert stated.fabric.s1 == pytest.approx(LAW[0], rel=1e-3)
