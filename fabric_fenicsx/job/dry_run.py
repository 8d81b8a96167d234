"""The checks of a job without its run."""

import math
import resource
import time
from collections.abc import Mapping

from mpi4py import MPI

from ..results.output import Output
from ..runtime.collective_errors import all_or_none
from ..runtime.formatting import rounded
from ..runtime.status import task
from ..scene import output as scene_output
from ..solve.newton import Newton
from ..solve.stepping import LoadStepping
from . import validity
from .job import Job

# iterations of a run with contact over the root of those of its first step, of its steps and of its
# sheets: 0.75 to 1.4 times as many in presses of one to five sheets, in 4 to 40 steps and on 100 to
# 3000 cells a sheet; a third where a strip between sheets of metal is bent
USUAL = 11.5
ENOUGH = 100  # iterations of the first step: more of them do not tell of later steps
GROWTH = 0.75  # exponent of an iteration's time over cells; 0.6 was measured up to 4000 of them
LOW, HIGH = 0.7, 1.4  # of the cost, as it is told
STATE, PICTURES = 3.0, 3.3  # s to draw the last state; time of all other pictures over the first's


def checked(
    job: Job, output: Output, part: str, pictures: bool, more: Mapping[str, float]
) -> list[str]:
    """Check all that a run checks before its first step, draw its first picture, and take the first
    step; sentences on the size and the cost. more: {name of a further run: times as many cells}.
    Raises InputError as `Job.run`."""
    scene, comm = job.scene, job.scene.comm
    with all_or_none(comm), task("checking the scene"):
        scene.check_start()
    folder = output.folder(part)
    for warning in [*job.setup.warnings, *validity.warnings_at_start(scene)]:
        output.tell(warning)
    newton = Newton(scene, job.tolerance, linear_solver=job.linear_solver)
    scene_output.nodal_fields(scene, scene_output.cell_fields(scene))  # no name is given twice
    newton.stiffness(newton.x)  # compiles
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    fixed = began = time.process_time()
    if pictures:
        job.setup.first_picture(folder)
        fixed += STATE + PICTURES * (time.process_time() - began)
    iterations, seconds, failure = _first_step(newton, job)
    output.tell(failure)
    sheets = max(1, len(scene.blank.parts))

    def cost(cells=1.0, steps=job.steps, fixed=fixed):
        solves = min(iterations, ENOUGH) * steps
        if scene.has_lagged_terms:
            solves = USUAL * math.sqrt(solves * sheets)
        total = fixed + solves * seconds * cells**GROWTH
        low, high = (rounded(each * total, 2) for each in (LOW, HIGH))
        return f"{low} to {high} s"

    terms = ", ".join(scene_output.summary(scene)["terms"])
    size = scene_output.sizes(scene)
    lines = [
        f"{size['cells']} cells ({size['element']}), {size['dofs']} degrees of freedom; {terms}",
        f"the run takes {cost()}, and several times as long where plies crumple: {iterations} "
        f"iterations at the first of {job.steps:g} steps took {rounded(seconds, 2)} s each, setup"
        f"{' and pictures take' if pictures else ' takes'} about {rounded(fixed, 2)} s",
    ]
    if job.error:
        steps = job.coarser_settings(job.setup.FEWER_STEPS).steps
        told = cost(1 / 4, steps, fixed=0)
        lines.append(f"the run on coarser cells, for errors, takes {told} more")
    lines += [f"{name} takes {cost(cells)} more" for name, cells in more.items()]
    return [
        *lines,
        f"memory without pictures about {rounded(comm.allreduce(peak, MPI.SUM), 2)} MiB",
    ]


@task("taking the first step")
def _first_step(newton, job):
    """Iterations up to the first state under load, seconds of one, and why it failed, or ""."""

    def is_enough():
        progress = stepping.progress
        return "enough" if progress.load or progress.iterations >= ENOUGH else ""

    stepping = LoadStepping(newton, job, stop=is_enough)
    began = time.process_time()
    outcome = stepping.run()
    taken, failed = max(1, outcome.iterations), not (outcome.reached or is_enough())
    return taken, (time.process_time() - began) / taken, outcome.reason if failed else ""
