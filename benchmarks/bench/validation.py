"""Bias tests of Cao et al. (2008): the law is fitted to one size, the others are predicted."""

import csv
from pathlib import Path

import numpy as np
from mpi4py import MPI

from fabric_fenicsx.coupons.bias_extension import BiasExtension
from fabric_fenicsx.coupons.simulated import simulated_bias
from fabric_fenicsx.identification import identify_simulated
from fabric_fenicsx.identification.curves import Curve, Sheet
from fabric_fenicsx.identification.curves.model import response
from fabric_fenicsx.job.setup import Observer
from fabric_fenicsx.material.laws.coupled import WovenFabric
from fabric_fenicsx.solve.progress import Accepted

DATA = Path(__file__).parents[1] / "data"
# laboratory, width, height [mm] of the test that the law is fitted to
FITTED = dict.fromkeys(("plain", "balanced twill"), ("INSA-NU", 150, 450))
FITTED["unbalanced twill"] = "UN", 100, 300
SHEET = Sheet("glass/PP of Cao et al.", thickness=1.2, density=0.619, balanced=True)
# of the plain weave, 150 x 450 mm, Fig. 36: displacement [mm] -> shear angle in the middle [deg] by
# hand, by images and as printed from the usual formula
MIDDLE = {20: (5.8, 5.5, 7.9), 40: (13.5, 13.6, 16.5)}
MIDDLE |= {60: (25.3, 22.1, 26.1), 80: (31.7, 30.9, 37.2)}


def _table(name, weave):
    """Angles (n,) [deg], rows (m) of a weave, and their values at the angles (m, n)."""
    lines = [line for line in open(DATA / name, encoding="utf-8") if not line.startswith("#")]
    rows = [row for row in csv.DictReader(lines) if row["weave"] == weave]
    angles = [key for key in rows[0] if key.isdigit()]
    values = np.array([[row[angle] for angle in angles] for row in rows], float)
    return np.array(angles, float), rows, values


def bias_tests(weave):
    """The raw bias tests of a weave by laboratory, width and height."""
    angles, rows, forces = _table("cao2008_bias.csv", weave)
    gamma, found = np.radians(angles), {}
    for row, force in zip(rows, forces):
        name = row["laboratory"], int(row["width_mm"]), int(row["height_mm"])
        keys = {"width": float(name[1]), "height": float(name[2])}
        what = "{} {}x{}".format(*name), "bias_extension", np.outer(gamma, [0, 0, 1])
        measured = response("F", force, gamma, "bias_extension", keys, SHEET.thickness)
        displacement = (name[2] - name[1]) * (np.cos(gamma / 2) + np.sin(gamma / 2) - 1)
        # with noise, so that all angles count alike
        more: dict = {"noise": ("value", 0.05), "keys": keys, "displacement": displacement}
        found[name] = Curve(*what, (measured,), np.arange(len(gamma)), 2, **more)
    return found


def frames(weave):
    """Shear angles (n,) [deg], and normalised shear forces of picture frames (m, n) [N/mm]."""
    angles, _, forces = _table("cao2008_frames.csv", weave)
    return angles, forces


def normalised(fabric, angles):
    """Normalised shear force (n,) [N/mm] of the law at shear angles [deg]."""
    g = np.radians(angles)
    tau = fabric.derivatives(0 * g, 0 * g, g, second=False).first[2]
    return tau * fabric.thickness / np.cos(g)


def fitted(weave):
    """The law of a weave, by the test of `FITTED`."""
    curve = bias_tests(weave)[FITTED[weave]]
    return identify_simulated(SHEET, [curve], simulated_bias).fabric


def ratios(weave, fabric):
    """Simulated over measured force of each test of the weave, by the angle of the crosshead."""
    rows = []
    for name, curve in bias_tests(weave).items():
        off = simulated_bias(fabric, curve)[0] / curve.responses[0].values
        row = {"weave": weave, "test": curve.file, "fitted": name == FITTED[weave]}
        angles = (f"{a:.0f} deg" for a in np.degrees(curve.strains[:, 2]))
        rows.append(row | dict(zip(angles, off.round(3).tolist())))
    return rows


def middle_angles(fabric: WovenFabric) -> list[float]:
    """Simulated shear angles [deg] at the displacements of `MIDDLE`."""
    size: dict = {"length": 450, "width": 150, "strain": max(MIDDLE) / 450}
    strip = BiasExtension(fabric, **size, nx=18, pattern="graded").build(MPI.COMM_SELF)
    middle, angles = strip.near_centre(), dict[float, float]()

    class Middle(Observer):
        def accept(self, accepted: Accepted) -> None:
            gamma = np.abs(strip.membrane.invariants_at_points()[..., 3]).mean(1)
            angles[accepted.load] = float(np.degrees(gamma[middle].mean()))

    loads = [d / max(MIDDLE) for d in MIDDLE]
    strip.job(steps=16, milestones=loads, observers=[Middle()]).run(pictures=False)
    return [angles[load] for load in loads]
