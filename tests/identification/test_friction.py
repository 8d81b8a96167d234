"""Friction of measured loops, and fits to simulated specimens."""

import math

import numpy as np
import pytest
from scipy import stats
from scipy.optimize import curve_fit
from synthetic_curves import bias_test

from fabric_fenicsx.core.errors import SolverFailure
from fabric_fenicsx.identification import curves as data
from fabric_fenicsx.identification import identify, identify_simulated
from fabric_fenicsx.identification.curves import Curve, Sheet
from fabric_fenicsx.identification.curves.model import response
from fabric_fenicsx.identification.separate import fit_friction
from fabric_fenicsx.material import kernel
from fabric_fenicsx.material.friction import ShearFriction
from fabric_fenicsx.material.homogeneous import conjugate, gradient
from fabric_fenicsx.material.presets import PRESETS, load

KOMEILI = PRESETS["komeili"]
ONE, TWO = ShearFriction(0.15, 0.006), ShearFriction((0.3, 0.03), (0.005, 0.006))
SHEET = 'name = "own"\nbalanced = true\nthickness_mm = 0.5\ndensity_g_per_cm3 = 0.75\n'
FRAME, SIDE = 200.0, 150.0


def loop(folder, friction, test="shear", turn=40.0):
    """Write a loop to `turn` and back to 0 [deg], step by step by the kernel."""
    fabric = KOMEILI.replace(shear_friction=friction)
    angles = np.concatenate([np.linspace(1, turn, 40), np.linspace(turn, 0, 41)[1:]])
    sliding = np.zeros((1, len(friction.stiffness)))
    F = gradient(*(0 * angles, 0 * angles, np.radians(angles)))
    tau = []
    for each in F:
        now = kernel.evaluate(fabric, gradient=[each], sliding=sliding)
        sliding = now.sliding
        tau.append(conjugate(each[None] @ now.S, each[None])[0, 2])
    head, values = "# test: shear\ngamma [deg], tau [MPa]\n", np.array(tau)
    if test == "picture_frame":
        head = f"# test: picture_frame\n# frame_length: {FRAME} mm\n# fabric_length: {SIDE} mm\n"
        head += "gamma [deg], F [N]\n"
        values = values * 0.5 * SIDE**2 / (FRAME * np.sin(math.pi / 4 - np.radians(angles) / 2))
    (folder / "sheet.toml").write_text(SHEET)
    rows = "".join(f"{g:.6f}, {v:.9g}\n" for g, v in zip(angles, values))
    (folder / "loop.csv").write_text(head + rows)
    return identify(*data.read(folder))


@pytest.mark.parametrize("test", ["shear", "picture_frame"])
@pytest.mark.parametrize("friction", [ONE, TWO])
def test_a_loop_gives_friction_and_law_apart(tmp_path, friction, test):
    found = loop(tmp_path, friction, test=test)
    fitted = found.fabric.shear_friction
    # between points the loading branch is interpolated
    assert fitted.stiffness == pytest.approx(friction.stiffness, rel=0.05)
    assert fitted.strength == pytest.approx(friction.strength, rel=0.02)
    angles = np.array([0.2, 0.4, 0.6])
    laws = found.fabric, KOMEILI
    fit, true = (law.derivatives(0 * angles, 0 * angles, angles).first[2] for law in laws)
    assert fit == pytest.approx(true, abs=1e-3 * true.max())
    assert not [each for each in found.warnings if "toe" in each]
    assert any(line.startswith("shear_friction.stiffness_1 was fitted") for line in found.remarks())


def widths(logarithms, angle, turn):
    """Of loops of springs in series with sliders: the way back is the first way, twice as large."""
    k, f = np.exp(logarithms)

    def first(g):
        return np.minimum(k * g, f)

    return first(angle) - first(turn) + 2 * first((turn - angle) / 2)


BACK, AT = np.linspace(0.68, 0.02, 50), np.log([0.15, 0.006])


def slopes(at):
    """Of widths at `BACK`, by the logarithms of both numbers."""
    h = 1e-6 * np.eye(2)
    return np.transpose([(widths(at + e, BACK, 0.7) - widths(at - e, BACK, 0.7)) / 2e-6 for e in h])


def turned(noise):
    """A loop with friction `ONE` to 0.7 rad, and its widths with noise."""
    g, width = np.linspace(0.01, 0.7, 60), widths(AT, BACK, 0.7) + noise
    there = 0.05 * g + np.minimum(0.15 * g, 0.006)
    down = np.interp(BACK, g, there) - width
    up, down = (response("tau", v, v, "shear", {}, 0.5) for v in (there, down))
    rows = np.outer(g, [0, 0, 1]), (up,), np.arange(60), 2
    return Curve("loop.csv", "shear", *rows, back=(BACK, down)), width


@pytest.mark.parametrize("noise", [0.0, 2e-4])
def test_intervals_are_those_of_another_program(noise):
    """SciPy's curve_fit of the widths; their noise counts as 1 % of half the largest at least."""
    curve, width = turned(noise * np.random.default_rng(3).normal(size=50))
    found = fit_friction([curve])
    start = np.log([0.14, 0.0062])
    best, covariance = curve_fit(lambda x, *v: widths(v, x, 0.7), BACK, width, start)
    rss = np.sum((widths(best, BACK, 0.7) - width) ** 2)
    if not noise:
        jacobian = slopes(best)
        covariance = np.linalg.inv(jacobian.T @ jacobian) * (0.005 * width.max()) ** 2
    assert len(found.determined) == 2
    for p, x, error in zip(found.determined.values(), best, np.sqrt(np.diag(covariance))):
        half = stats.t.ppf(0.975, 48) * error
        ends = np.exp([x - half, x + half])
        assert p.value == pytest.approx(np.exp(x), rel=1e-4)
        assert p.standard_error == pytest.approx(np.exp(x) * error, rel=1e-2)
        assert p.interval == pytest.approx(ends, rel=1e-3) and not p.weak
    assert found.report()["scatter_MPa"] == pytest.approx(np.sqrt(rss / 50), rel=1e-4, abs=1e-9)


@pytest.mark.parametrize("times", [0.95, 1.05])
def test_numbers_are_told_within_a_factor_of_three(times):
    """And are weak from a factor of two on: noise of any size, across what they can follow."""
    jacobian = slopes(AT)
    r = np.random.default_rng(5).normal(size=50)
    r -= jacobian @ np.linalg.lstsq(jacobian, r, rcond=None)[0]
    covariance = np.linalg.inv(jacobian.T @ jacobian) * (r @ r) / 48
    half = stats.t.ppf(0.975, 48) * np.sqrt(covariance.diagonal().max())
    found = fit_friction([turned(r * times * math.log(3) / half)[0]])
    assert (found is None) == (times > 1)
    found = fit_friction([turned(r * times * math.log(2) / half)[0]])
    assert any(p.weak for p in found.determined.values()) == (times > 1)


def test_friction_acts_in_both_zones_of_a_bias_test():
    """At half the angle in one of them, where it is not yet sliding."""
    keys, g = {"height": 300.0, "width": 100.0}, np.linspace(0.01, 0.2, 20)
    by = response("F", g, g, "bias_extension", keys, 0.5)
    tau, at_half = (0.05 * x + np.minimum(0.15 * x, 0.006) for x in (g, g / 2))
    by = response("F", by.gain * tau + by.half * at_half, g, "bias_extension", keys, 0.5)
    bias = Curve("bias.csv", "bias_extension", np.outer(g, [0, 0, 1]), (by,), np.arange(20), 2)
    found = identify(Sheet("own", 0.5, 0.75, True), [turned(0.0)[0], bias])
    assert max(curve["rms_error_of_peak"] for curve in found.report()["curves"]) < 1e-6
    assert found.fabric.s1 == pytest.approx(0.05, rel=1e-4)


GLASS = Sheet("glass", 1.2, 0.619, True)
GAMMA = np.radians(np.arange(5.0, 50, 5))
TRUE = [0.06, -0.12, 0.18]
FABRIC = load("komeili").replace(**dict(zip(("s1", "s2", "s3"), TRUE)))


def raw(force):
    return bias_test(force, GAMMA, 300.0, 100.0, 0.01)


def specimen(fabric, curve, curved=0.1):
    """Forces that are not linear in the parameters, and their derivatives."""
    by = GAMMA[:, None] ** np.arange(1, 4) * 300
    x = by @ [fabric.s1, fabric.s2, fabric.s3]
    return x - curved * x**2 / 10, by * (1 - curved * x[:, None] / 5)


@pytest.mark.parametrize("why", ["could not be simulated: no", "did not converge"])
def test_a_specimen_that_tells_nothing_leaves_the_first_fit(why):
    count = iter(range(100))

    def simulate(fabric, curve):
        if "converge" not in why:
            raise SolverFailure("no")
        force, slopes = specimen(fabric, curve)
        return force * (1 + 0.5 * (next(count) % 2)), slopes

    curve = raw(specimen(FABRIC, None)[0])
    found, start = identify_simulated(GLASS, [curve], simulate), identify(GLASS, [curve])
    assert found.fabric == start.fabric and found.simulated is None
    assert why in found.warnings[-1] and "homogeneous shear" in found.warnings[-1]


def test_specimens_give_their_fabric_back():
    noisy = specimen(FABRIC, None)[0] * (1 + 0.01 * np.random.default_rng(0).normal(size=9))
    for force, rel in ((specimen(FABRIC, None)[0], 1e-3), (noisy, 0.2)):
        found = identify_simulated(GLASS, [raw(force)], specimen)
        start, fit = identify(GLASS, [raw(force)]), found.simulated
        values, first = ([f.s1, f.s2, f.s3] for f in (found.fabric, start.fabric))
        assert values == pytest.approx(TRUE, rel=rel)
        assert [*fit["homogeneous"].values()] == first
        for told, fabric in ((fit["off_homogeneous"], start.fabric), (fit["off"], found.fabric)):
            off = np.sqrt(np.mean((specimen(fabric, None)[0] - force) ** 2)) / force.max()
            assert told == {"bias.csv": pytest.approx(off, rel=1e-6)}
