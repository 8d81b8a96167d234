"""What every law has: found by its file, a kernel from its energy alone, a material file."""

from dataclasses import dataclass

import numpy as np
import pytest
from builders import sheet
from fabrics import LAW58, TABLE

from fabric_fenicsx import InputError, Membrane, Scene, load
from fabric_fenicsx.core.rules import above_zero
from fabric_fenicsx.material import functions
from fabric_fenicsx.material.functions import HyperDual, exp, negative, positive, sqrt
from fabric_fenicsx.material.homogeneous import lateral_strain, nominal
from fabric_fenicsx.material.laws import COUPLINGS, LAWS, Law
from fabric_fenicsx.material.presets import PRESETS
from fabric_fenicsx.studies.lib.coupling_variants import coupling_variants


@pytest.fixture(scope="module")
def fabrics(unbalanced):
    off = {f"without {name}": unbalanced.without(name) for name in COUPLINGS}
    own = {"coupled": unbalanced, "FABRIC": unbalanced.decoupled()}
    return own | {"law58": LAW58, "table": TABLE} | off


NAMES = ["coupled", "FABRIC", "law58", "table", *(f"without {name}" for name in COUPLINGS)]


def states(n=4000, seed=4):
    rng = np.random.default_rng(seed)
    eps_a, eps_b = rng.uniform(-0.2, 0.06, (2, n))
    gamma = rng.uniform(-1.2, 1.2, n)
    eps_a[:20] = eps_b[10:30] = gamma[20:40] = 0  # on the kinks, too
    return eps_a, eps_b, gamma


@pytest.mark.parametrize("name", NAMES)
def test_closed_forms_are_the_derivatives_of_the_energy(fabrics, name):
    """Against hyper-dual numbers. Second derivatives are sums of terms that cancel, such as those
    of k_SC: so each is compared on the scale of its own largest value, of which rounding leaves
    1e-14, and not on its own."""
    fabric = fabrics[name]
    closed, energy = fabric.derivatives(*states()), Law.derivatives(fabric, *states())
    size = np.abs(energy.parts).sum(-1).max()
    assert np.abs(closed.parts - energy.parts).max() <= 1e-12 * size
    stress = np.linalg.norm(energy.first, axis=0) + fabric.shear_stiffness
    assert (np.abs(closed.first - energy.first) / stress).max() <= 1e-12
    largest = np.abs(energy.second).max(1, keepdims=True)
    assert (np.abs(closed.second - energy.second) <= 1e-13 * largest).all()
    assert fabric.derivatives(*states(), second=False).second is None


def test_every_law_answers_what_is_asked_of_it(fabrics):
    for fabric in fabrics.values():
        assert LAWS[fabric.law] is type(fabric)
        assert fabric.decoupled().couplings == frozenset()
        assert not fabric.couplings or len(coupling_variants(fabric)) == 4
        assert fabric.plausibility_warnings() == [] and fabric.shear_stiffness > 0
    assert (LAW58.shear_stiffness, PRESETS["komeili"].shear_stiffness) == (0.025, 25.06e-3)
    for law, name, low, high in (
        (LAW58.replace(B_a=0.0), "E_a", 2.0, 2e5),
        (LAW58, "E_b", 2.0, 2e5),
        (LAW58.replace(G_T=9.0), "G_0", 1e-4, 10.0),
        (LAW58, "thickness", 0.01, 20.0),
        (LAW58, "density", 0.05, 10.0),
        (LAW58, "fibre_density", 0.8, 10.0),
    ):
        values = 0.98 * low, 1.02 * low, 0.98 * high, 1.02 * high
        said = [law.replace(**{name: value}).plausibility_warnings() for value in values]
        assert [*map(len, said)] == [1, 0, 0, 1], (name, said)
    symbols = LAW58.symbols(lambda v: 2 * v)  # as of constants of a form
    assert (symbols.E_a, symbols.thickness, symbols.density) == (2670.0, 0.8, LAW58.density)


def test_a_law_of_a_users_script_is_known_by_its_name(tmp_path):
    @dataclass(frozen=True)
    class Linear(Law):
        law = "linear"
        rules = {"E": above_zero("stress")}
        E: float

        def energy(self, eps_a, eps_b, gamma):
            return self.E * eps_a**2 / 2, self.E * eps_b**2 / 2, self.E * gamma**2 / 20

    try:
        path = tmp_path / "m.toml"
        path.write_text('law = "linear"\nE_GPa = 1\nthickness_mm = 1\ndensity_g_per_cm3 = 1\n')
        fabric = load(path)
        strains = np.array([[0.01, -0.02, 0.3]])
        assert type(fabric) is Linear
        assert type("Linear", (Linear,), {"law": "again"}) is LAWS.pop("again")
        assert nominal(fabric, strains)[0] == pytest.approx([10.0, -20.0, 30.0])
        assert lateral_strain(fabric, 0, strains[:, 0]) == 0
    finally:
        del LAWS["linear"]


def own_law(energy):
    """A law of one number E with this energy; it is not kept among `LAWS`."""
    rules = {"E": above_zero("stress")}
    fields = {"law": "own", "rules": rules, "__annotations__": {"E": float}}
    made = type("Own", (Law,), fields | {"energy": lambda self, *strains: energy(*strains)})
    del LAWS["own"]
    return dataclass(frozen=True)(made)


SHEAR = {
    "biaxial": lambda a, b, g: 0.01 * a * b + g**2,
    "tension_shear": lambda a, b, g: g**2 * (1 + positive(a)),
    "compression_shear": lambda a, b, g: g**2 * exp(negative(b)),
}


@pytest.mark.parametrize("name", SHEAR)
def test_a_coupling_that_a_law_cannot_switch_off(name):
    """Silently variants would all be the same."""
    law = own_law(lambda a, b, g: (a**2, b**2, SHEAR[name](a, b, g)))(E=3.0)
    words = f"without: the energy of law own has the coupling {name}, and the law cannot switch it"
    for switched in (lambda: law.without(name), law.decoupled, lambda: coupling_variants(law)):
        with pytest.raises(InputError, match=words):
            switched()
    others = [each for each in COUPLINGS if each != name]
    assert law.without(*others) is law


@pytest.mark.parametrize(
    "energy, words",
    [
        (lambda a, b, g: (exp(a * a), b**2, g**2), "the energy of law own is 1 MPa without strain"),
        (lambda a, b, g: (1e3 * a**2, b**2, 0.01 * g**2 + 2.2e-7 * g), "stress tau of law own is"),
        (lambda a, b, g: (sqrt(a * a), b**2, g**2), "stress sigma_a of law own is nan MPa with"),
        (lambda a, b, g: (1e3 * a * a, b * b, -1e-3 * g**2), "along gamma is -0.002 MPa with"),
    ],
)
def test_a_fabric_is_at_rest_without_strain(energy, words):
    """Otherwise a run would tell to take smaller steps."""
    with pytest.raises(InputError, match=words):
        Scene(sheet(10, 10, 2, 2), [Membrane(own_law(energy)(E=3.0))])


def test_functions_of_laws_have_their_derivatives():
    """By complex steps and differences of these."""
    x, h = np.array([0.3, 0.7]), 1e-6
    for f, exact in (
        *((getattr(functions, k), getattr(np, k)) for k in ("sqrt", "log", "exp", "sin", "cos")),
        (functions.tan, np.tan),
        (functions.atan, np.arctan),
        (lambda v: v**3, lambda v: v**3),
        (lambda v: v**1, lambda v: v**1),
        (lambda v: 2 / v - v / 3, lambda v: 2 / v - v / 3),
        (lambda v: 3 - abs(-v) * v, lambda v: 3 - v * v),
        (lambda v: positive(v - 0.5) ** 2, lambda v: np.where(v.real > 0.5, (v - 0.5) ** 2, 0 * v)),
        (lambda v: negative(v - 0.5) ** 2, lambda v: np.where(v.real > 0.5, 0 * v, (v - 0.5) ** 2)),
    ):
        a, b, _ = HyperDual.variables(x, 2 * x, 0 * x)
        found = f(a) * b
        slope = [exact(v + 1e-30j).imag / 1e-30 for v in (x, x + h, x - h)]
        assert found.value == pytest.approx(exact(x) * 2 * x)
        assert found.first[:2] == pytest.approx(np.stack([slope[0] * 2 * x, exact(x)]))
        second = (slope[1] - slope[2]) / (2 * h) * 2 * x
        assert found.second[:3] == pytest.approx(np.stack([second, slope[0], 0 * x]), abs=1e-7)
