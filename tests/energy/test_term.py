"""A term of one's own, and what a scene tells its terms."""

import csv

import numpy as np
import pytest
import ufl
from builders import Elastic, Springs, displacement, sheet
from mpi4py import MPI

import fabric_fenicsx as ff
from fabric_fenicsx.energy.output import last
from fabric_fenicsx.results.states import read_state
from fabric_fenicsx.scene import output as reports

COMM = MPI.COMM_WORLD
KOMEILI = ff.load("komeili")
K = 0.05  # of the bedding [N/mm^3]


class Bedding(ff.Term):
    """An elastic bedding, which resists displacement by `stiffness` k [N/mm^3]: k |u|^2 / 2."""

    name = energy_kind = "bedding"

    def __init__(self, stiffness):
        self.stiffness = stiffness

    def set_up(self, scene):
        u = scene.blank.u
        self.energy = 0.5 * self.stiffness * ufl.inner(u, u) * ufl.dx

    def traction(self):
        return -self.stiffness * displacement(self.blank)

    def history(self):
        largest = COMM.allreduce(abs(self.traction()).max(initial=0.0), MPI.MAX)
        return {"bedding_traction_MPa": largest}

    def nodal_fields(self):
        return {"bedding_traction": ff.Value(self.traction(), "MPa")}


def scene_with(*terms):
    blank = sheet(20.0, 10.0, 2, 1)
    blank.divide({"left": lambda x: x[0] < 10}, rest="right")
    return ff.Scene(blank, [ff.Membrane(KOMEILI), *terms], ff.clamped_ends(0.1))


@pytest.mark.mpi
def test_an_own_term_is_in_history_summary_fields_and_energy_balance(folder):
    stroke, blank = 2.0, sheet(100.0, 25.0, 12, 3)
    scene = ff.Scene(blank, [ff.Membrane(KOMEILI), Bedding(K)], ff.clamped_ends(stroke))
    result = ff.Job(scene, steps=5, every=1).run(folder, pictures=False)
    assert result.summary["terms"] == ["membrane", "bedding"]
    assert result.summary["energy_imbalance"] < 0.01
    if COMM.rank != 0:
        return
    with open(folder / "history.csv") as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0])[-2:] == ["bedding_energy_Nmm", "bedding_traction_MPa"]
    stored = result.summary["energy"]["bedding"]
    assert float(rows[-1]["bedding_energy_Nmm"]) == stored > 0
    assert float(rows[-1]["bedding_traction_MPa"]) == pytest.approx(K * stroke)
    grid = read_state(folder)
    assert grid["bedding_traction"] == pytest.approx(-K * grid["u"][:, :2], abs=1e-12)
    assert "bedding_traction [MPa]" in grid.field_data["units"]


def test_terms_that_a_scene_refuses():
    used = Elastic()
    scene_with(used)
    for terms, words in (
        ([used], "term elastic is in another scene already; each"),
        ([type("Stored", (Springs,), {"energy_kind": None})()], "needs an `energy_kind`"),
        ([type("Kept", (Springs,), {"memory": dict})()], "has a memory and needs `recall`"),
        ([Bedding(K).on("left")], "bedding of left, which is on a part, .* `self.part.dx"),
    ):
        with pytest.raises(ff.InputError, match=words):
            scene_with(*terms)


def telling(method, rule=lambda value: value):
    """A class of terms that give `hits`, 1 or -2, by `method`."""

    def tell(self):
        size = self.blank.whole.cells.size if "cell" in method else len(self.blank.whole.nodes)
        value = -2 if self.name == "other" else 1
        return {"hits": rule(np.full(size, value) if "fields" in method else value)}

    silent = {"history": dict, "nodal_fields": dict}
    return type("Mine", (Bedding,), silent | {"name": "mine", "energy_kind": "mine", method: tell})


def test_a_field_or_an_entry_that_two_terms_give():
    """At load 0, not when a long run ends."""
    mine, other, loads = telling("cell_fields")(K), telling("cell_fields")(K), []
    other.name, other.set_load = "other", loads.append
    scene = scene_with(mine, other)
    words = "`cell_fields` of term other returns the field hits, which term mine returns already"
    with pytest.raises(ff.InputError, match=words):
        ff.Job(scene, steps=1).run()
    assert set(loads) <= {0.0}


@pytest.mark.mpi
@pytest.mark.parametrize("method", ["cell_fields", "history"])
@pytest.mark.parametrize("rule, merged", [(ff.least, -2), (ff.total, 0), (last, 1)])
def test_terms_that_say_how_their_values_are_merged_may_share_a_name(method, rule, merged):
    terms = [telling(method, rule)(K) for _ in range(3)]
    terms[1].name = "other"
    scene = scene_with(*terms)
    assert np.all(getattr(reports, method)(scene)["hits"] == merged)
