"""Fields of the place in a scene: forces and energies of each cell and node are its own."""

import numpy as np
import pytest
import scenes
from builders import compiled_as_it_stands

import fabric_fenicsx as ff

KOMEILI = ff.load("komeili")
COLD = {"shear_factor": 8.0, "yarn_factor": 1.1}
FACTORS = {20.0: COLD, 200.0: dict.fromkeys(COLD, 1.0)}
WARM = KOMEILI.replace(at_temperatures=FACTORS, shear_friction=ff.ShearFriction(0.05, 0.002))


def press(*sheets, friction=0.2):
    return scenes.press(*sheets, interface=ff.Interface(friction=friction))


def sheet(**given):
    return ff.Sheet(**{"fabric": KOMEILI, "length": 100, "width": 80, "nx": 5} | given)


def answers(scene):
    """Forces [N] and energies [N mm] of a bent sheet that was pressed and then slid."""
    r, x = scene.u.duplicate(), scene.u.duplicate()
    for load, seed in ((0.2, 1), (0.5, 2)):
        scene.set_load(load)
        x.array[:] = np.random.default_rng(seed).uniform(-0.3, 0.3, x.local_size)
        scene.set(x)
        scene.accept()
    x.array[:] *= 0.8
    scene.set(x)
    scene.residual(r)
    return scene.forces.array.copy(), np.array([*scene.energies().values()])


def same(one, two):
    for mine, others in zip(one, two):
        assert mine == pytest.approx(others, rel=1e-10, abs=1e-10 * abs(others).max())


def test_constant_fields_are_the_numbers():
    """Of two plies, and of all that acts on them."""
    of_ply = {"fibre_angle": 30.0, "thickness": 0.8, "temperature": 110.0, "friction": 0.4}
    plies = {"lower": {"name": "lower", "fabric": WARM}, "upper": {"name": "upper", "nx": 4}}
    found = []
    for make in (float, lambda number: lambda *x: number + 0 * x[0]):
        fields = {name: make(value) for name, value in of_ply.items()}
        of_upper = {name: fields[name] for name in ("fibre_angle", "thickness")}
        made = sheet(**plies["lower"], **fields), sheet(**plies["upper"], **of_upper)
        found.append(answers(press(*made, friction=make(0.15)).build().scene))
    same(*found)


def test_two_temperatures_are_two_materials_and_two_thicknesses_two_sheets():
    """The sheet of cells whose halves differ has the sum of the halves' forces."""

    def forces(*terms):
        blank = ff.Blank.rectangle(40, 20, nx=4, centred=True, spatial=True)
        blank.divide({"left": lambda x: x[0] < 0}, rest="right")
        return answers(ff.Scene(blank, terms))

    fields = {
        "temperature": lambda x, y: np.where(x < 0, 20.0, 155.0),
        "thickness": lambda x, y: np.where(x < 0, 0.5, 2.0),
    }
    states = ("left", 20.0, 0.5), ("right", 155.0, 2.0)
    halves = [ff.Membrane(WARM.at(t).replace(thickness=h)).on(name) for name, t, h in states]
    same(forces(ff.Membrane(WARM, **fields)), forces(*halves))


@pytest.mark.versions
def test_states_and_derivatives_are_those_of_the_energy():
    """Also stresses of the kernel, which is given the numbers of each point."""
    blank = ff.Blank.rectangle(40, 20, nx=3, element="P2")
    with compiled_as_it_stands():
        membrane = ff.Membrane(WARM, temperature=lambda x, y: 30 + 4 * x + y)
        scene = ff.Scene(blank, [membrane])
        blank.u.x.array[:] = np.random.default_rng(3).uniform(-0.05, 0.05, len(blank.u.x.array))
        ff.check_derivatives(membrane, scene, size=1e-5)
        state, *_, mismatch = membrane.state()
    assert mismatch < 1e-9
    energy = blank.areas() @ (state.energy @ membrane.weights)
    assert energy == pytest.approx(scene.energies()["strain"], rel=1e-9)
    least = membrane.cell_fields()["stability_ellipticity"].value.min()
    assert membrane.history()["min_stability"].value == pytest.approx(least, rel=1e-9)


def test_thickness_is_where_faces_touch_and_friction_of_plies_of_the_flat_place():
    thickness, fabric = lambda x, y: 0.6 + 0.004 * x, KOMEILI.replace(thickness=0.9)
    friction = lambda x, y: np.where(x < 0, 0.1, 0.5)  # noqa: E731
    lower = sheet(name="lower", fabric=fabric, thickness=thickness, friction=friction)
    built = press(lower, sheet(name="upper")).build()
    ball = built.contacts[0]
    at = built.scene.blank.parts["lower"].nodes
    grown = KOMEILI.thickness_under(0.0)
    told = thickness(*ball.nodes.places[at, :2].T) * grown
    assert ball.thickness[at] == pytest.approx(told)
    assert ball.thickness[~at] == pytest.approx(grown)
    contact = next(t for t in built.scene.terms if isinstance(t, ff.SheetContact))
    share = (thickness(0.0, 0.0) + 1.0) / (0.8 + 1.0)
    assert np.mean(contact.faces.now.growth) == pytest.approx(share, rel=2e-3)
    x = contact.points.flat_places()
    assert contact.friction_state.coefficient == pytest.approx(friction(x[:, 0], x[:, 1]))
    assert x[:, 0].min() < -45 and x[:, 0].max() > 45


def test_a_press_tells_what_ran(tmp_path):
    """And takes a file that has changed for another one."""
    (tmp_path / "T.csv").write_text("x,y,T\n-50,-40,20\n50,-40,120\n-50,40,20\n50,40,120\n")
    told = press(sheet(fabric=WARM, temperature=str(tmp_path / "T.csv")))
    told.write(tmp_path / "press.toml")
    built = ff.Press.read(tmp_path / "press.toml").build()
    assert built.field_ranges() == {"blank.temperature_C": "23.33 to 116.7 (T.csv)"}
    (tmp_path / "T.csv").write_text("x,y,T\n-50,-40,20\n50,-40,120\n-50,40,20\n50,40,121\n")
    other = ff.Press.read(tmp_path / "press.toml").build()
    assert other.fingerprint() != built.fingerprint()
