"""What single studies tell, of made laws and fields."""

from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import pytest
from builders import sheet

import fabric_fenicsx as ff
from fabric_fenicsx.material import stability
from fabric_fenicsx.material.laws import LAWS
from fabric_fenicsx.results import shape
from fabric_fenicsx.studies.lib import compression_parameters as parameters
from fabric_fenicsx.studies.lib.single_element import compare
from fabric_fenicsx.studies.lib.stability_maps import kernel_difference, stability_maps


@dataclass(frozen=True)
class Off(ff.WovenFabric):
    """Komeili's with stresses a thousandth above those of its energy."""

    law = "off"

    def derivatives(self, eps_a, eps_b, gamma, second=True):
        found = super().derivatives(eps_a, eps_b, gamma, second)
        return found._replace(first=1.001 * found.first)


del LAWS["off"]
KOMEILI = ff.load("komeili")
OFF = Off(KOMEILI.warp, KOMEILI.weft, KOMEILI.s1, KOMEILI.s2, KOMEILI.s3, thickness=0.8)


def test_a_law_that_is_a_thousandth_off():
    assert 0.9e-3 < kernel_difference(OFF, np.linspace(-0.1, 0.05, 4)) < 1.001e-3
    blank = sheet(1.0, 1.0, 1, 1, cell="quadrilateral")
    found = compare({"off": OFF}, blank, ff.Membrane, 4, 1e-10)
    assert found.kernel_mismatch == pytest.approx(1e-3, rel=0.01)
    for path, off in found.differences.items():
        assert 0.7e-3 < off["kernel"] < 1.001e-3, path  # of the stresses' norm
        assert off["elements"] < 1e-9, path  # which follow the energy
    assert found.largest["kernel"] == pytest.approx(1e-3, rel=0.01)
    row = list(found.rows())[-1]  # free tension: the lateral strain has no stress
    assert (row["path"], row["eps_a"], row["gamma_deg"]) == ("free uniaxial a", 0.03, 0)
    assert abs(row["sigma_b_closed_form_MPa"]) < 1e-9
    sigma = [row[f"sigma_a_{leg}_MPa"] for leg in ("closed_form", "elements", "kernel")]
    assert sigma == pytest.approx(np.array([1, 1, 1.001]) * sigma[0], rel=1e-8)
    sheared = [row for row in found.rows() if row["path"] == "pure shear"][-1]
    g = np.radians(sheared["gamma_deg"])
    tau = (0.02506 - 0.18679 * g + 0.56239 * g**2) * g
    assert (sheared["gamma_deg"], sheared["tau_closed_form_MPa"]) == pytest.approx((60, tau))


def test_maps_of_stability(unbalanced):
    """By rows eps_b, at the angle of their picture; shares are those of states."""
    strains = np.array([-0.15, -0.05, 0.03])
    maps, shares = stability_maps(unbalanced, strains)
    found = maps["p_min"]["40 deg", "p_min 0.25"]
    fabric = unbalanced.replace(p_min=0.25)
    for i, eps_b in enumerate(strains):
        for j, eps_a in enumerate(strains):
            C = np.array([1 + eps_a, 1 + eps_b]) ** 2
            across = np.sin(np.radians(40)) * np.sqrt(C.prod())
            state = np.array([[C[0], across, C[1], np.radians(40)]])  # I4, I6, I8, gamma
            single = stability.evaluate(fabric, state)
            assert found[0][i, j] == pytest.approx(single.convexity[0])
            assert found[1][i, j] == pytest.approx(single.ellipticity[0])
    for k, name in enumerate(("convexity", "ellipticity")):
        lost = (found[k] < 0).sum() / 9
        assert shares["40 deg, p_min 0.25"][name] == pytest.approx(lost, abs=1e-4)


def test_parameters_of_compression(monkeypatch):
    assert parameters.changed(KOMEILI, {"p_min": 0.5, "E_C": 13.0, "s_C": 10.0}).warp.d == 6.5
    varied = parameters.variants(["E_C", "s_C"])
    assert len(varied) == 8 and varied[0] == ("E_C", 0.13, {"p_min": 0.75, "E_C": 0.13, "s_C": 100})
    data = {"stability_ellipticity": np.array([-1e-6, 0.0, 1e-6])}
    grid = parameters.with_lost_ellipticity(SimpleNamespace(cell_data=data))
    assert grid.cell_data["ellipticity_lost"].tolist() == [1, 0, 0]
    monkeypatch.setattr(shape, "contrast", lambda grid, name: 0.1 if name == "shear_angle" else 0)
    assert parameters.shear_contrast(None) == pytest.approx(np.degrees(0.1))
    q = {"shear_angle_max_deg": 1, "cells_that_lost_ellipticity": 2}
    q |= {"stability_ellipticity_min": 4, "log_eps_11": (5, 0), "log_eps_22": (6, 0)}
    q["draw_in"] = {"largest_mm": 7, "smallest_mm": 0}
    summary = {"quantities": q, "stroke_reached": 8, "reaction_N": 3}
    row = parameters.row("s_C", 10.0, summary, 9, "")
    assert list(row.values()) == [14, "s_C", 10.0, 8, 1, 9, 2, 4, 5, 6, 7, 3, ""]
