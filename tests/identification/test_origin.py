"""Slack and the load cell's zero: found, told where nothing tells them, and in the intervals."""

import numpy as np
import pytest
from curve_texts import SHEET, folder
from scipy import stats

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


@pytest.mark.parametrize(
    "unknown, value, rel", [("zero", "slack: 2 mm", 1e-3), ("slack", "zero: 0.4 N", 0.1)]
)
def test_what_an_origin_leaves_uncertain_widens_intervals(tmp_path, unknown, value, rel):
    """By what a fit moves from where the origin is stated to an end of its interval."""
    x = np.linspace(0, 50, 60)

    def told(*keys):
        more = "".join(f"# {key}\n" for key in (value, *keys))
        return fit(tmp_path, sheared("bias_extension", x, 2.0, 0.4, 0.004, more=more))

    found = told()
    origin, unit = found.origins[f"{unknown} of t.csv"], "N" if unknown == "zero" else "mm"
    assert origin.standard_error == pytest.approx((origin.interval[1] - origin.interval[0]) / 4)
    known, *ends = (told(f"{unknown}: {v:.9g} {unit}") for v in (origin.value, *origin.interval))
    for name, p in found.determined.items():
        (low, high), there = p.interval, known.determined[name]
        half = (there.interval[1] - there.interval[0]) / 2
        moved = max(abs(end.determined[name].value - there.value) for end in ends)
        assert moved > 0.3 * half
        assert high - low == pytest.approx(2 * np.hypot(half, moved), rel=rel)
        error = there.standard_error * np.hypot(half, moved) / half
        assert p.standard_error == pytest.approx(error, rel=rel)


@pytest.mark.parametrize("slack, zero", [(1.3, 0.0), (0.0, -20.0)])
def test_intervals_of_an_origin(tmp_path, slack, zero):
    """Of a strip of 200 x 50 mm, one being stated, by least squares with a power series for the
    force; its noise of 5 N is seen by the program, which also lets the law be off by 3 %."""
    x, grid = np.linspace(0, 6, 200), np.linspace(-1, 1, 401)
    e = np.maximum(x - slack, 0) / 200
    force = 60 * (3 * 4130 * e + 2 * 667.5) * e
    sd = np.hypot(5, 0.03 * force)
    force = force + 5 * np.random.default_rng(2).normal(size=200)
    grid = slack + 0.3 * grid if slack else zero + 20 * grid

    def left(value):
        loaded = np.maximum(x - value, 0) if slack else x
        A = loaded[:, None] ** np.arange(1, 6) / sd[:, None]
        b = (force if slack else force + zero - value) / sd
        return np.sum((A @ np.linalg.lstsq(A, b, rcond=None)[0] - b) ** 2)

    sums = np.array([left(value) for value in grid])
    most = sums.min() + max(sums.min() / 194, 1) * stats.t.ppf(0.975, 194) ** 2
    likely, best = grid[sums <= most], grid[sums.argmin()]
    stated = "zero: 0 N" if slack else "slack: 0 mm"
    keys = "# test: uniaxial_a\n# lateral: held\n# length: 200 mm\n# width: 50 mm\n"
    rows = "".join(f"{a:.6f},{b:.6f}\n" for a, b in zip(x, force + zero))
    found = fit(tmp_path, f"{keys}# {stated}\ndisplacement [mm],F [N]\n{rows}")
    (origin,) = found.origins.values()
    near = {"abs": 0.1 * np.ptp(likely)}
    assert (*origin.interval, origin.value) == pytest.approx((*likely[[0, -1]], best), **near)


def test_what_tells_no_origin_is_said(tmp_path):
    """Just above and below a tenth of the way, and with 11 and 12 points."""
    for first, count, why in (
        (5.1, 30, "as it begins at 10 % of its way"),
        (0, 11, "as it has 11 points, and 12 would tell; state `# slack: 0 mm` and `# zero: 0 N`"),
        (4.9, 12, ""),
    ):
        found = fit(tmp_path, sheared("bias_extension", np.linspace(first, 50, count), 6, 0.5))
        words = [w for w in found.warnings if "nothing tells its slack and zero, taken as 0" in w]
        assert bool(found.origins) == (not why) == (not words) and why in "".join(words)
    stated = "# slack: 0 mm\n# zero: 0 N\n"
    found = fit(tmp_path, sheared("bias_extension", np.linspace(9, 50, 30), more=stated))
    assert not found.origins and not any("nothing tells" in w for w in found.warnings)
    assert found.fabric.s1 == pytest.approx(LAW[0], rel=1e-3)
