"""One element against closed form and kernel along paths of homogeneous states: Fig. 7 of Schäfer
et al."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from fabric_fenicsx.core.errors import SolverFailure
from fabric_fenicsx.energy.membrane import Membrane
from fabric_fenicsx.io.units import DEG
from fabric_fenicsx.material.homogeneous import conjugate, gradient, lateral_strain
from fabric_fenicsx.material.kernel import evaluate
from fabric_fenicsx.material.laws import Law
from fabric_fenicsx.material.laws.base import stresses_of_energy
from fabric_fenicsx.scene import output
from fabric_fenicsx.scene.scene import Scene
from fabric_fenicsx.scene.supports import rolling_ends
from fabric_fenicsx.sheet.blank import Blank
from fabric_fenicsx.solve.newton import Newton
from fabric_fenicsx.solve.settings import Settings
from fabric_fenicsx.solve.stepping import LoadStepping

# name -> function of s in [0, 1] (n,) to eps_a, eps_b [-], gamma [rad]; panel of Fig. 7
PATHS: dict[str, Callable[[np.ndarray], tuple[np.ndarray, np.ndarray, np.ndarray]]] = {
    "constrained uniaxial a": lambda s: (-0.20 + 0.23 * s, 0 * s, 0 * s),
    "constrained uniaxial b": lambda s: (0 * s, -0.20 + 0.23 * s, 0 * s),
    "equibiaxial": lambda s: (-0.20 + 0.23 * s, -0.20 + 0.23 * s, 0 * s),
    "biaxial 2:1": lambda s: (0.03 * s, 0.015 * s, 0 * s),
    "biaxial 1:2": lambda s: (0.015 * s, 0.03 * s, 0 * s),
    "tension a, compression b": lambda s: (0.03 * s, -0.20 * s, 0 * s),
    "in-plane compression": lambda s: (-0.20 * s, -0.10 * s, 0 * s),
    "pure shear": lambda s: (0 * s, 0 * s, 60 * DEG * (2 * s - 1)),
    "simple shear": lambda s: (
        0 * s,
        1 / np.cos(s * np.arccos(1 / 1.03)) - 1,
        s * np.arccos(1 / 1.03),
    ),  # until b is 3 % longer
    "shear, 1 % pre-tension": lambda s: (0 * s + 0.01, 0 * s + 0.01, 60 * DEG * s),
    "shear, 3 % pre-tension": lambda s: (0 * s + 0.03, 0 * s + 0.03, 60 * DEG * s),
    "shear, 5 % pre-compression": lambda s: (0 * s - 0.05, 0 * s - 0.05, 60 * DEG * s),
    "shear, 20 % pre-compression": lambda s: (0 * s - 0.20, 0 * s - 0.20, 60 * DEG * s),
}
FREE = "free uniaxial a"
MODELS = "hyperelastic", "FABRIC"
COMPONENTS = "along a", "along b", "shear"
# title -> (path, component of the stress, abscissa: eps_a or gamma)
PANELS = {
    "(a) uniaxial": (
        ("constrained uniaxial a", 0, "a"),
        ("constrained uniaxial a", 1, "a"),
        (FREE, 0, "a"),
    ),
    "(b) biaxial": (("equibiaxial", 0, "a"), ("biaxial 2:1", 0, "a"), ("biaxial 1:2", 0, "a")),
    "(c) compression": (("in-plane compression", 0, "a"), ("in-plane compression", 1, "a")),
    "(d) shear": (
        ("shear, 1 % pre-tension", 2, "g"),
        ("shear, 5 % pre-compression", 2, "g"),
        ("shear, 20 % pre-compression", 2, "g"),
        ("pure shear", 2, "g"),
    ),
}
AXES = (r"$\varepsilon_a$ / %", "nominal stress / MPa")
LABELS: dict[str, tuple] = {
    "(a) uniaxial": (*AXES, (-1, 3.2)),
    "(b) biaxial": (*AXES, (-1, 3.2)),
    "(c) compression": (*AXES, None),
    "(d) shear": ("shear angle / deg", AXES[1], (0, 62)),
}


class Curve(NamedTuple):
    """Strains (3, n) of a path's states, and the conjugate stresses (n, 3) [MPa] there by the
    closed form, the kernel and finite elements."""

    strains: np.ndarray
    closed: np.ndarray
    kernel: np.ndarray
    elements: np.ndarray


@dataclass
class Comparison:
    """Curves by (model, path), the differences to the closed form by "model: path", and the largest
    relative difference of the kernel from UFL at the elements' points."""

    curves: dict[tuple[str, str], Curve] = field(default_factory=dict)
    differences: dict[str, dict[str, float]] = field(default_factory=dict)
    kernel_mismatch: float = 0.0

    @property
    def largest(self) -> dict[str, float]:
        """Largest difference to the closed form of the elements and of the kernel; relative, or to
        s1 where stresses are smaller."""
        return {
            leg: max(each[leg] for each in self.differences.values())
            for leg in ("elements", "kernel")
        }

    def rows(self) -> Iterable[dict[str, Any]]:
        """Rows of curves.csv, a state each."""
        for (model, path), curve in self.curves.items():
            for k in range(curve.strains.shape[1]):
                eps_a, eps_b, gamma = curve.strains[:, k]
                row = {"model": model, "path": path, "eps_a": eps_a, "eps_b": eps_b}
                row["gamma_deg"] = np.degrees(gamma)
                for leg, stresses in zip(("closed_form", "kernel", "elements"), curve[1:]):
                    for name, stress in zip(("sigma_a", "sigma_b", "tau"), stresses[k]):
                        row[f"{name}_{leg}_MPa"] = stress
                yield row

    def panels(self) -> dict[str, dict]:
        """Curves of PANELS, {title: {(label, model): (x, closed form, kernel, elements)}}."""
        series: dict[str, dict] = {}
        for title, entries in PANELS.items():
            series[title] = {}
            for path, component, over in entries:
                for model in MODELS:
                    strains, *legs = self.curves[model, path]
                    x = 100 * strains[0] if over == "a" else np.degrees(strains[2])
                    drawn = x, *(stresses[:, component] for stresses in legs)
                    series[title][f"{path}, {COMPONENTS[component]}", model] = drawn
        return series


def compare(
    fabrics: Mapping[str, Law],
    blank: Blank,
    membrane: Callable[[Law], Membrane],
    points: int,
    tolerance: float,
) -> Comparison:
    """The `Comparison` for {model: fabric} along all paths, at so many `points` each.

    blank: of one element; membrane: gives that of a fabric; tolerance: of the residual in free
    tension. Raises SolverFailure where the elements find no state.
    """
    found, s = Comparison(), np.linspace(0, 1, points)
    for model, fabric in fabrics.items():
        scene = Scene(blank, [membrane(fabric)])
        for path in [*PATHS, FREE]:
            if path == FREE:
                eps_a = 0.03 * s
                free = Scene(blank, [membrane(fabric)], rolling_ends(eps_a[-1]))
                lateral, elements = free_uniaxial(free, eps_a, tolerance)
                strains = np.stack([eps_a, lateral_strain(fabric, 0, eps_a), 0 * s])
                difference = np.abs(lateral - strains[1]).max()
            else:
                strains, difference = np.stack(PATHS[path](s)), 0.0
                elements, mismatch = prescribed(scene, strains)
                found.kernel_mismatch = max(found.kernel_mismatch, mismatch)
            F = gradient(*strains)
            kernel = conjugate(F @ evaluate(fabric, gradient=F).S, F)
            closed = np.stack(stresses_of_energy(fabric, *strains), -1)
            scale = np.maximum(np.linalg.norm(closed, axis=1), fabric.shear_stiffness)[:, None]
            gaps = [float((np.abs(x - closed) / scale).max()) for x in (elements, kernel)]
            found.differences[f"{model}: {path}"] = {
                "elements": max(gaps[0], difference),
                "kernel": gaps[1],
            }
            found.curves[model, path] = Curve(strains, closed, kernel, elements)
    return found


def prescribed(scene: Scene, strains: np.ndarray) -> tuple[np.ndarray, float]:
    """Conjugate stresses (n, 3) [MPa] of finite elements at prescribed states (3, n), and the
    kernel's largest relative difference from UFL."""
    membrane: Any
    (membrane,) = scene.terms
    F, x = gradient(*strains), membrane.blank.coordinates()[:, :2]
    P, r, mismatch = np.empty_like(F), scene.u.duplicate(), 0.0
    for k in range(len(F)):
        membrane.blank.u.x.array[:] = (x @ (F[k] - np.eye(2)).T).ravel()
        scene.residual(r)
        P[k] = output.virial(scene) / membrane.fabric.thickness
        mismatch = max(mismatch, membrane.state()[3])
    return conjugate(P, F), mismatch


def free_uniaxial(
    scene: Scene, eps_a: np.ndarray, tolerance: float
) -> tuple[np.ndarray, np.ndarray]:
    """Lateral strains (n,) and conjugate stresses (n, 3) [MPa] that elements find under free
    tension to each of `eps_a` (n,), evenly spaced from 0. Raises SolverFailure if they don't find
    all."""
    membrane: Any
    (membrane,) = scene.terms
    scene.blank.u.x.array[:] = 0
    found = [(0.0, 0.0)]

    def accept(accepted):
        if accepted.load > 0:
            across = np.sqrt(membrane.state()[0].invariants[:, :, 2]) - 1
            across = np.concatenate(scene.comm.allgather(across.ravel()))  # one or two cells
            stress = scene.reaction("moving grip")[0] / membrane.fabric.thickness
            found.append((across.mean(), stress))

    settings = Settings(steps=len(eps_a) - 1, path_tolerance=None)
    outcome = LoadStepping(Newton(scene, tolerance), settings, on_accept=accept).run()
    if outcome.reached < 1 or len(found) != len(eps_a):
        raise SolverFailure(outcome.reason or "free uniaxial tension needed cuts")
    lateral, stress = np.array(found).T
    return lateral, np.stack([stress, 0 * stress, 0 * stress], -1)
