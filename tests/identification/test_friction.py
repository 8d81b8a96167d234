"""Friction between yarns from loops in shear."""

import math

import numpy as np
import pytest

from fabric_fenicsx.identification import curves as data
from fabric_fenicsx.identification import identify
from fabric_fenicsx.material import kernel
from fabric_fenicsx.material.friction import ShearFriction
from fabric_fenicsx.material.homogeneous import conjugate, gradient
from fabric_fenicsx.material.presets import PRESETS

KOMEILI = PRESETS["komeili"]
ONE, TWO = ShearFriction(0.15, 0.006), ShearFriction((0.3, 0.03), (0.005, 0.006))
SHEET = 'name = "own"\nbalanced = true\nthickness_mm = 0.5\ndensity_g_per_cm3 = 0.75\n'
FRAME, SIDE = 200.0, 150.0


def loop(folder, friction, noise=0.0, test="shear", turn=40.0):
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
    values = values + noise * values.max() * np.random.default_rng(0).standard_normal(len(values))
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
    fit, true = (
        law.derivatives(0 * angles, 0 * angles, angles).first[2] for law in (found.fabric, KOMEILI)
    )
    assert fit == pytest.approx(true, abs=1e-3 * true.max())
    assert not [each for each in found.warnings if "toe" in each]
    assert any(line.startswith("shear_friction.stiffness_1 was fitted") for line in found.remarks())


def test_intervals_hold_the_numbers_of_a_loop_with_noise(tmp_path):
    found = loop(tmp_path, ONE, noise=0.01)
    for name, true in (("stiffness", 0.15), ("strength", 0.006)):
        low, high = found.friction.determined[f"shear_friction.{name}_1"].interval
        assert low < true < high < 1.5 * low
    noise = 0.01 * found.fits[0][1].peak * math.sqrt(2)  # of two ways
    assert found.report()["shear_friction"]["scatter_MPa"] == pytest.approx(noise, rel=0.3)


def test_without_a_way_back_there_is_no_friction(tmp_path):
    loop(tmp_path, ONE)
    file = tmp_path / "loop.csv"
    file.write_text("\n".join(file.read_text().splitlines()[:42]))
    found = identify(*data.read(tmp_path))
    assert found.friction is None and found.fabric.shear_friction is None
