"""The tensile study as a user runs it, on the paper's specimen."""

import csv
import json
import sys
from functools import partial
from pathlib import Path

import meshio
import numpy as np
import pytest
import pyvista
from builders import said
from mpi4py import MPI
from scipy.optimize import brentq

from fabric_fenicsx.command_line.study import Study
from fabric_fenicsx.material import kernel
from fabric_fenicsx.material.laws import LAWS
from fabric_fenicsx.material.presets import PRESETS
from fabric_fenicsx.postprocess.states import read_state
from fabric_fenicsx.solve import stepping
from fabric_fenicsx.solve.progress import Progress
from fabric_fenicsx.solve.viscosity import Viscosity

COMM = MPI.COMM_WORLD
sys.path.insert(0, str(Path(__file__).parents[2] / "studies"))
import tensile  # noqa: E402

MESH = "--element", "P1", "--nx", 100, "--ny", 25, "--pattern", "crossed"
FULL = *MESH, "--steps", 20, "--path-tolerance", 1e-5, "--no-error"


def balance(summary):
    energy = summary["energy"]
    return abs(energy["external_work"] - energy["strain"]) / energy["strain"]


def rows(folder):
    with open(folder / "history.csv") as file:
        return [{k: float(v) for k, v in row.items() if v} for row in csv.DictReader(file)]


# on one rank `test_a_curve_to_five_digits_is_cheap` has the same run
@pytest.mark.mpi
def test_the_papers_specimen(launch):
    done = launch("tensile", *FULL, "--verbose", "--path-tolerance", 1e-8)
    s = done.summary
    assert done.status == 0, done.err
    assert (s["converged"], s["stroke_reached"], s["ranks"]) == (True, 1, COMM.size)
    wall = s["wall_s"]
    assert sum(wall.values()) - wall["total"] == pytest.approx(wall["total"], rel=0.05)
    assert s["kernel_mismatch"] <= 1e-10
    assert balance(s) <= 2e-3
    assert -0.155 <= s["quantities"]["log_eps_22_min"] <= -0.135
    # the last steps of each solve shrink with the square of the one before, in the energy norm
    solves = done.out.split("iteration  0")[1:]
    assert len(solves) == 20
    for solve in solves:
        steps = [
            float(line.split("step of")[1].split()[0])
            for line in solve.splitlines()
            if "energy norm" in line
        ]
        assert 2 <= len(steps) <= 5 and steps[-1] <= 2 * steps[-2] ** 2
    history = rows(done.folder)
    assert [r["load"] for r in history] == pytest.approx(np.linspace(0, 1, 21))
    force = np.array([r["reaction_N"] for r in history])
    assert np.all(np.diff(force) > 0)
    assert np.abs(np.diff(force, 3)).max() < 0.02 * force.max()  # smooth
    assert history[-1]["reaction_N"] == s["reaction_N"]
    grid = pyvista.PVDReader(done.folder / "fields.pvd")
    assert grid.time_values == pytest.approx([0, 0.25, 0.5, 0.75, 1])
    for picture in ("maps.png", "curve.png"):
        assert (done.folder / picture).stat().st_size > 10_000


def test_a_curve_to_five_digits_is_cheap(launch):
    def pulled(*options):
        mesh = "--nx", 24, "--ny", 6, "--no-pictures"
        s = launch("bias_extension", *FULL, *mesh, *options)
        return s.summary, np.array([row["reaction_N"] for row in rows(s.folder)])

    (exact, forces), (cheap, mine) = pulled("--path-tolerance", 1e-8), pulled()
    assert mine == pytest.approx(forces, rel=1e-5, abs=1e-5)
    assert cheap["reaction_N"] == pytest.approx(exact["reaction_N"], rel=1e-8)
    assert cheap["newton_iterations"] <= 70 < exact["newton_iterations"]


# of --tolerance 1e-11 on one rank on Debian 12 (DOLFINx 0.5.2); what runs on two, or on Debian 13
# (0.9.0), must say the same
SAME_EVERYWHERE = {
    "tensile": (2033.64783014, 5781.89806120),
    "bias_extension": (0.52341637531, 3.54541421312),
}


@pytest.mark.versions
@pytest.mark.mpi
@pytest.mark.parametrize("study", SAME_EVERYWHERE)
def test_numbers_are_the_same_on_every_debian(launch, study):
    # a state of equilibrium, to which few steps lead as well
    options = "--steps", 5, "--no-pictures", "--tolerance", 1e-11
    s = launch(study, *FULL, *options).summary
    assert (s["reaction_N"], s["energy"]["strain"]) == pytest.approx(
        SAME_EVERYWHERE[study], rel=1e-8
    )


def test_energy_balance_is_better_than_chords_make_it(launch):
    """Straight lines between the states are off by 8.5e-5 with 20 steps and a quarter of that with
    40; parabolas by much less."""
    options = ("--nx", 10, "--path-tolerance", 1e-5, "--no-pictures")
    errors = [balance(launch("tensile", *options, "--steps", n).summary) for n in (20, 40)]
    assert errors[0] < 1e-5 and errors[1] < errors[0]


@pytest.mark.parametrize("options", [("--without", "biaxial"), ("--model", "fabric")])
def test_no_contraction_without_the_biaxial_coupling(launch, options):
    # the state is homogeneous, on any mesh
    coarse = "--nx", 20, "--ny", 5, "--steps", 5, "--no-pictures"
    s = launch("tensile", *FULL, *coarse, *options).summary
    assert max(map(abs, s["quantities"]["eps_b"])) < 1e-6
    assert s["reaction_N"] == pytest.approx(
        50 * (3 * 4130 * 0.03**2 + 2 * 667.5 * 0.03), rel=1e-9
    )  # eq. (14)
    assert "biaxial" not in s["couplings"]


def test_comparison_of_the_variants(launch):
    """Beside a curve that was made with all couplings."""
    measured = Path(__file__).parents[2] / "studies/data/komeili_all/free_a.csv"
    done = launch("tensile", "--quick", "--compare", "--measured", measured)
    assert done.status == 0, done.err
    assumed, *_ = done.out.splitlines()
    assert assumed.startswith("no test has determined these numbers of komeili: d = 0.65 MPa")
    assert done.out.count("free_a.csv: simulated and measured force differ by ") == 4
    found = done.summary["quantities"]
    off = {name: found[name]["measured"][0]["rms_of_peak"] for name in found}
    assert off["all couplings"] < 0.05 < 0.15 < off["FABRIC"]
    report = (done.folder / "report.html").read_text()
    assert all(f"<h2>{variant}</h2>" in report for variant in done.summary["variants"])
    for picture in ("compare.png", "compare_curves.png"):
        assert (done.folder / picture).stat().st_size > 10_000


@pytest.mark.versions
@pytest.mark.parametrize("element", ["P2", pytest.param("Q1", marks=pytest.mark.mpi)])
def test_fields_for_paraview_are_those_of_the_solution(launch, element):
    # on ranks others draw
    pictures = () if COMM.size == 1 else ("--no-pictures",)
    options = "--grips", "rollers", "--turned", 30, "--element", element
    done = launch("tensile", "--quick", *options, *pictures)
    assert done.status == 0, done.err
    grid = read_state(done.folder, 1.0)
    assert grid.n_cells == done.summary["cells"]
    q = done.summary["quantities"]
    expected = {
        "eps_a": 0.03,
        "eps_b": q["eps_b"][0],
        "log_eps_11": np.log(1.03),
        "log_eps_22": q["log_eps_22_min"],
        "shear_angle": 0,
        "I4": 1.03**2,
        "I6": 0,
        "I8": (1 + q["eps_b"][0]) ** 2,
        "I10": 0,
        "strain_state": 2,
        "sigma_b": 0,
        "sigma_a": q["nominal_stress_MPa"] / (1 + q["eps_b"][0]),
    }
    for name, value in expected.items():
        assert grid.cell_data[name] == pytest.approx(value, abs=1e-7), name
    total = sum(grid.cell_data[f"energy_{part}"] for part in ("a", "b", "shear"))
    assert total * 200 * 50 == pytest.approx(done.summary["energy"]["strain"], rel=1e-9)
    along = np.array([np.cos(np.pi / 6), np.sin(np.pi / 6), 0])
    assert grid.cell_data["a"] == pytest.approx(np.tile(1.03 * along, (grid.n_cells, 1)), abs=1e-7)
    used = np.unique(grid.cell_connectivity)
    x, u = np.asarray(grid.points)[used], grid.point_data["u"][used]
    assert u @ along == pytest.approx(0.03 * (x @ along), abs=1e-6)


def test_a_load_that_cannot_be_reached(launch):
    options = "--element", "P1", "--strain", 1, "--max-strain", 10, "--no-pictures"
    done = launch("bias_extension", "--quick", *options)
    assert done.status == 3, done.err
    (said,) = [
        line
        for line in done.err.splitlines()
        if line.startswith("studies/bias_extension.py: stopped: gave up at load factor")
    ]
    s = done.summary
    assert not s["converged"]
    assert 0.5 < s["stroke_reached"] < 1
    assert s["reason"] in said
    assert "Traceback" not in done.err
    history = rows(done.folder)
    assert history[-1]["load"] == pytest.approx(s["stroke_reached"])
    assert pyvista.PVDReader(done.folder / "fields.pvd").time_values[-1] == pytest.approx(
        s["stroke_reached"]
    )
    assert "rejected after" in done.err
    assert s["energy"]["viscous"] == pytest.approx(history[-1]["viscous_energy_Nmm"])


def test_what_the_regularisation_takes_is_told(tmp_path, monkeypatch, capsys):
    """With a drag of 0.3 N/mm on the nodes from the start; it fades at full load and leaves the
    state as it is without."""
    viscosity = Viscosity(0.3, stiffness=300.0, easy_steps_asked=100)
    monkeypatch.setattr(stepping, "Progress", partial(Progress, viscosity=viscosity))
    options = ["--quick", "--no-pictures", "--element", "P1"]
    tensile.main(Study("tensile", tensile.options(), [*options, "--out", str(tmp_path)]))
    summary, history = json.loads((tmp_path / "summary.json").read_text()), rows(tmp_path)
    told = [row for row in history if row["viscous_energy_Nmm"] > 0.01 * row["strain_energy_Nmm"]]
    lines = capsys.readouterr().err.splitlines()
    (said,) = (line for line in lines if "the regularisation has taken" in line)
    assert said.startswith(f"warning: at load {told[0]['load']:.6g} (step {told[0]['step']:.0f})")
    assert summary["energy"]["viscous"] == pytest.approx(history[-1]["viscous_energy_Nmm"])
    monkeypatch.undo()
    tensile.main(Study("tensile", tensile.options(), [*options, "--out", str(tmp_path / "free")]))
    free = json.loads((tmp_path / "free" / "summary.json").read_text())
    assert summary["converged"] and free["energy"]["viscous"] == 0 < summary["energy"]["viscous"]
    assert summary["reaction_N"] == pytest.approx(free["reaction_N"], rel=1e-7)


def test_a_material_that_is_not_a_number_at_run_time(launch, shared_path):
    material = PRESETS["komeili"].dumps().replace("a = 4130.0", "a = 1e308")
    (shared_path / "m.toml").write_text(material)
    COMM.barrier()
    done = launch("tensile", "--quick", "--material", "m.toml")
    assert done.status == 3, done.err
    assert "the energy, its forces or its tangent are not a number" in done.err
    assert not done.summary["converged"]
    report = (done.folder / "report.html").read_text()
    assert "gave up" in report and "Done" not in report
    assert len(rows(done.folder)) == 1
    assert pyvista.PVDReader(done.folder / "fields.pvd").time_values == [0.0]


def test_more_ranks_than_cells(launch):
    few = "--nx", 1, "--ny", 1, "--element", "Q1", "--steps", 2, "--no-pictures"
    done = launch("tensile", *few, ranks=2)
    assert done.status == 0, done.err
    assert done.summary["cells"] == 1


def test_a_comparison_goes_on_where_it_was_killed(launch):
    options = ("--nx", 8, "--steps", 2, "--compare", "--no-pictures")
    whole = launch("tensile", *options)
    for file in (whole.folder / "FABRIC").glob("*.*"):
        file.unlink()
    again = launch("tensile", *options, "--resume")
    assert again.status == 0, again.err
    assert again.out == whole.out


@pytest.mark.parametrize("study", ["tensile", "picture_frame"])
def test_a_tabulated_material_runs_in_every_study(launch, tmp_path, study):
    """Fine tables of the preset `fabric`'s curves give its reactions."""
    from fabric_fenicsx.material.laws.base import stresses_of_energy

    eps, gamma = np.r_[-0.5, -0.2, np.linspace(0, 0.06, 13)], np.linspace(0, 1.4, 29)
    for name in ("warp", "weft"):
        sigma = stresses_of_energy(PRESETS["fabric"], eps, 0, 0)[0]
        text = "eps [%], sigma [MPa]\n" + "".join(
            f"{float(100 * e)!r}, {float(s)!r}\n" for e, s in zip(eps, sigma)
        )
        (tmp_path / f"{name}.csv").write_text(text)
    tau = stresses_of_energy(PRESETS["fabric"], 0, 0, gamma)[2]
    text = "gamma [rad], tau [MPa]\n" + "".join(
        f"{float(g)!r}, {float(t)!r}\n" for g, t in zip(gamma, tau)
    )
    (tmp_path / "shear.csv").write_text(text)
    keys = 'model = "fabric"\nthickness_mm = 1.0\ndensity_g_per_cm3 = 0.75\n'
    (tmp_path / "m.toml").write_text(
        keys + "".join(f'{n} = "{n}.csv"\n' for n in ("warp", "weft", "shear"))
    )
    tables, preset = (
        launch(study, "--quick", "--no-pictures", "--material", m).summary
        for m in ("m.toml", "fabric")
    )
    assert tables["converged"]
    assert tables["couplings"] == []
    assert tables["kernel_mismatch"] <= 1e-10
    interpolation = 2e-2
    assert tables["reaction_N"] == pytest.approx(preset["reaction_N"], rel=interpolation)


def test_what_is_said_first_holds_as_the_mesh_is_refined(launch):
    """Strains at the middle and between which 98 % of the area lies; the extremes, at the clamps'
    corners, grow."""
    coarse, fine = (
        launch("tensile", "--nx", nx, "--steps", 2, "--no-pictures", "--no-error")
        for nx in (24, 96)
    )
    q, r = coarse.summary["quantities"], fine.summary["quantities"]
    assert q["log_eps_22_middle"] == pytest.approx(r["log_eps_22_middle"], rel=1e-3)
    assert q["log_eps_22_98_percent"][0] == pytest.approx(r["log_eps_22_98_percent"][0], rel=0.01)
    assert q["shear_angle_98_percent_deg"] == pytest.approx(
        r["shear_angle_98_percent_deg"], rel=0.03
    )
    assert r["shear_angle_max_deg"] > 1.5 * q["shear_angle_max_deg"]
    assert f"along yarns b at the middle {100 * r['log_eps_22_middle']:.2f} %" in fine.out
    for name in ("log_eps_11", "log_eps_22"):
        (low, high), (least, most) = r[f"{name}_98_percent"], r[name]
        assert least <= low < r.get(f"{name}_middle", high) <= high <= most


def test_a_sheet_without_a_middle(launch, tmp_path):
    from fabric_fenicsx.meshes.specimen import specimen

    x, cells, kind = specimen(nx=20, ny=5)
    cells = cells[np.linalg.norm(x[cells].mean(1) - [100, 25, 0], axis=1) > 8]
    meshio.write_points_cells(tmp_path / "holed.msh", x, [(kind, cells)])
    for study, name in (
        ("tensile", "log_eps_22_middle"),
        ("bias_extension", "centre_shear_angle_deg"),
    ):
        done = launch(
            study, "--quick", "--mesh", "holed.msh", "--steps", 2, "--strain", 0.02, "--no-pictures"
        )
        assert done.status == 0, done.err
        assert done.summary["quantities"][name] is None
        (warning,) = [text for text in said(done.summary) if "hole at its centre" in text]
        assert warning in done.err and "no cell at the" in done.out
    assert done.summary["quantities"]["theory_shear_angle_deg"] is None
    assert "whole rectangle" in done.summary["quantities"]["no_theory_because"]


def test_a_pre_sheared_strip_comes_to_rest_before_load(launch):
    """Yarns at +-35 deg of a weave without shear at 90 deg: free sides, homogeneous, so the kernel
    has it all."""
    angles = np.radians([35, 145])
    yarns = np.stack([np.cos(angles), np.sin(angles)], -1)

    def across(strain):
        def state(eps):
            F = np.diag([1 + strain, 1 + eps])
            return kernel.evaluate(
                PRESETS["komeili"], gradient=F, fibres=yarns, weave_angle=np.pi / 2
            )

        eps = brentq(lambda e: state(e).S[0, 1, 1], -0.2, 0.2, xtol=1e-15)
        return eps, 50 * (1 + strain) * state(eps).S[0, 0, 0]

    options = ("--grips", "rollers", "--fibre-angle", 35, "--yarn-angle", 110, "--weave-angle", 90)
    done = launch("tensile", "--quick", *options, "--no-pictures", "--tolerance", 1e-12)
    assert done.status == 0 and "at rest in its supports, before load" in done.out, done.err
    first, *_, last = rows(done.folder)
    assert first["reaction_N"] == pytest.approx(across(0.0)[1], rel=1e-9)
    assert last["reaction_N"] == pytest.approx(across(0.03)[1], rel=1e-9)
    assert done.summary["quantities"]["width_at_middle_mm"] == pytest.approx(
        50 * (1 + across(0.03)[0]), rel=1e-9
    )
    assert done.summary["kernel_mismatch"] <= 1e-10
    assert first["strain_energy_Nmm"] > 9 and done.summary["energy_imbalance"] < 0.01


LAW_FILE = """
from dataclasses import dataclass
import fabric_fenicsx as ff
from fabric_fenicsx.runtime.rules import above_zero

@dataclass(frozen=True)
class Straight(ff.Law):
    law = "straight"
    rules = {"E": above_zero("stress")}
    E: float

    def energy(self, eps_a, eps_b, gamma):
        return self.E * eps_a**2 / 2, self.E * eps_b**2 / 2, self.E * gamma**2 / 200
"""


@pytest.mark.mpi
def test_a_law_in_a_file(launch, shared_path):
    """A fabric without couplings is pulled along its yarns: the force is E eps times its section,
    in which the clamps have no part."""
    law, material = shared_path / "law.py", shared_path / "m.toml"
    if COMM.rank == 0:
        law.write_text(LAW_FILE)
        material.write_text(
            'law = "straight"\nE_MPa = 100\nthickness_mm = 1\ndensity_g_per_cm3 = 1\n'
        )
    COMM.barrier()
    try:
        options = "--material", material, "--nx", 8, "--steps", 1, "--no-pictures"
        done = launch("tensile", "--law-file", law, *options)
        assert done.status == 0, done.err
        assert done.summary["reaction_N"] == pytest.approx(100 * 0.03 * 50, rel=1e-6)
    finally:
        LAWS.pop("straight", None)


@pytest.mark.parametrize(
    "text, words",
    [
        (None, "law.py' is not there or no Python file; allowed is a .py that exists"),
        ("no Python", "law.py fails (SyntaxError: invalid syntax"),
        ("1 / 0", "law.py fails (ZeroDivisionError: division by zero); allowed is one that runs"),
        ("x = 1", "the material komeili is of the law coupled; allowed is --material with a file"),
    ],
)
def test_a_law_file_that_is_none(launch, tmp_path, text, words):
    if text:
        (tmp_path / "law.py").write_text(text)
    done = launch("tensile", "--law-file", tmp_path / "law.py")
    assert done.status == 2 and words in done.err, done.err
