"""Hard cases of the solver: what a case asks for, how it is judged, and the table."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np
from mpi4py import MPI

import fabric_fenicsx as ff
from fabric_fenicsx.press.press import Press
from fabric_fenicsx.results import measures
from fabric_fenicsx.solve.newton import Newton
from fabric_fenicsx.solve.settings import Settings
from fabric_fenicsx.solve.stepping import LoadStepping

MORE = 1.25  # times the iterations measured are allowed
IMBALANCE = 0.02  # of the work may be missing from the energies, unless the sheet snaps


class Run:
    """A scene taken to full load. `outcome` is that of the stepping, `imbalance` the work that is
    missing from the energies at the end, over the largest of both on the way, `energy` that at the
    end [N mm]; `faults` are of accepted states in a plane. settings: those of a press; watch:
    called with the run and each load factor."""

    Solver: ClassVar[Callable[..., Newton]] = Newton

    def __init__(self, scene, settings=None, watch=None, steps=20):
        self.scene, self.faults, self._watch = scene, list[str](), watch
        self.newton, self.imbalance, self._most = self.Solver(scene), 0.0, 1e-12
        settings = settings or Settings(steps=steps, path_tolerance=None)
        self._tolerance = settings.path_tolerance or 1e-8
        self.outcome = LoadStepping(self.newton, settings, on_accept=self._accept).run()
        self.energy = sum(scene.energies().values())

    def _accept(self, accepted):
        stored, work = sum(accepted.energies.values()), accepted.external_work
        self._most = max(self._most, abs(work), abs(stored))
        self.imbalance = abs(work - stored) / self._most
        # states with a history are no longer what was solved for, once they are accepted
        if accepted.load and self.scene.blank.mesh.geometry.dim == 2:
            self._audit(accepted.load, accepted.progress.viscosity.drag)
        if self._watch:
            self._watch(self, accepted.load)

    def _audit(self, load, drag):
        """Name a residual, assembled anew, above the tolerance and above what rounding makes, and
        negative pivots of a tangent that is factorised anew at full load."""
        scene, tangent = self.scene, self.newton.tangent
        scene.residual(r := scene.u.duplicate())
        tolerance = self._tolerance if load < 1 else self.newton.tolerance
        enough = max(tolerance * scene.force_scale(), self.newton.directions.noise)
        if not drag and r.norm() > enough:
            self.faults.append(f"residual {r.norm():.1e} N at load {load:.4g}")
        if load == 1:
            tangent.assemble()
            if negative := tangent.negative_pivots():
                self.faults.append(f"{negative} negative pivots")

    def shear(self):
        """Largest shear angle at the points of the first term [deg]."""
        angle = np.abs(self.scene.terms[0].invariants_at_points()[..., 3])
        return np.degrees(measures.extremes(self.scene.comm, angle)[1])

    def height(self):
        """Largest displacement of a node along z [mm]."""
        moved = np.abs(self.scene.blank.nodal_displacement()[:, 2])
        return measures.extremes(self.scene.comm, moved)[1]


class Number(NamedTuple):
    """A number of a case, and from where to where its reference lets it be."""

    what: str
    value: float
    low: float
    high: float


def near(what, value, reference, rel):
    """A number that is to be its reference, to a share of that."""
    return Number(what, float(value), *sorted((reference * (1 - rel), reference * (1 + rel))))


@dataclass(frozen=True)
class Setting:
    """What all cases share: ranks and fabric."""

    comm: MPI.Comm
    fabric: ff.WovenFabric

    def press(self, press: Press, **options: object) -> tuple[Run, float]:
        """Run of a press, and the force of what moves [N]."""
        built = press.build(self.comm)
        run = Run(built.scene, built.job(**options))
        return run, float(built.measure(built.scene, 1.0)[1])


@dataclass(frozen=True)
class Case:
    """A case: `make` runs it and returns its runs and numbers; its docstring says what it is.
    iterations: measured, of which `MORE` are allowed; quick: it is one of those that `make test`
    runs; snaps: energy may be lost; stops: the load at which it stops at the earliest, as the law
    is unstable there, which the reason must say."""

    name: str
    make: Callable[[Setting], tuple[list[Run], list[Number]]]
    iterations: int
    quick: bool = False
    snaps: bool = False
    stops: float = 1.0

    def judge(self, setting: Setting) -> dict:
        """Row of the table; `flaws` says what the case fails by."""
        began = time.process_time()
        runs, numbers = self.make(setting)
        cpu = setting.comm.allreduce(time.process_time() - began)
        iterations = sum(run.outcome.iterations for run in runs)
        steps = sum(run.outcome.accepted for run in runs)
        reached = min(run.outcome.reached for run in runs)
        imbalance = max(run.imbalance for run in runs)
        flaws = list(dict.fromkeys(fault for run in runs for fault in run.faults))
        flaws += [f"{n.what} is {n.value:.6g}" for n in numbers if not n.low <= n.value <= n.high]
        reasons = [*dict.fromkeys(run.outcome.reason for run in runs if run.outcome.reason)]
        named = self.stops < 1 and all("the law" in reason for reason in reasons)
        if reached < self.stops or not (named or reached == 1):
            flaws.append(f"reached {100 * reached:.0f} % of the load")
        if iterations > MORE * self.iterations:
            flaws.append(f"{iterations} iterations; measured were {self.iterations}")
        if imbalance > IMBALANCE and not self.snaps:
            flaws.append(f"{100 * imbalance:.1f} % of the work is not in the energies")
        words = (f"{n.what} {n.value:.5g} ({n.low:.5g} to {n.high:.5g})" for n in numbers)
        row: dict = {"case": self.name, "is": " ".join(str(self.make.__doc__).split())}
        row |= {"holds": not flaws, "reached": reached, "steps": steps, "iterations": iterations}
        row |= {"rejected": sum(run.outcome.rejected for run in runs), "imbalance": imbalance}
        row |= {"cpu_s": round(cpu, 2), "numbers": "; ".join([*words, *reasons])}
        return row | {"flaws": "; ".join(flaws)}


HEAD = "case                     reached steps iterations rejected imbalance CPU/s  numbers"


def line(row: dict) -> str:
    """A row of the table."""
    text = f"{row['case']:24s} {100 * row['reached']:5.0f} % {row['steps']:5d} "
    text += f"{row['iterations']:10d} {row['rejected']:8d} {100 * row['imbalance']:7.2f} % "
    text += f"{row['cpu_s']:5.1f}  {row['numbers']}"
    return text + ("" if row["holds"] else f"\n     FAILS: {row['flaws']}")
