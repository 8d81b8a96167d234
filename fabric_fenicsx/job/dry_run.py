"""The checks of a job without its run."""

import resource
import time

from mpi4py import MPI

from ..core.formatting import rounded
from ..core.status import task
from ..results.output import Output
from ..scene import output as scene_output
from ..solve.newton import Newton
from ..solve.stepping import LoadStepping
from . import validity
from .job import Job


def checked(job: Job, output: Output, part: str, pictures: bool) -> list[str]:
    """Check all that a run checks before its first step, draw its first picture, and take the first
    step; sentences on the size and the cost. Raises InputError as `Job.run`."""
    scene, comm, began = job.scene, job.scene.comm, time.process_time()
    job.check()
    folder = output.folder(part)
    for warning in [*job.setup.warnings, *validity.warnings_at_start(scene)]:
        output.tell(warning)
    newton = Newton(scene, job.tolerance, linear_solver=job.linear_solver)
    scene_output.nodal_fields(scene, scene_output.cell_fields(scene))  # no name is given twice
    newton.stiffness(newton.x)  # compiles
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    job.setup.begin(folder, pictures)
    setup, before = time.process_time() - began, time.process_time()
    iterations, failure = _first_step(newton, job)
    seconds = time.process_time() - before
    output.tell(failure)

    def cost(cells=1.0, steps=job.steps, setup=setup):
        # iterations of a run over those of its first step times the steps: of strips and presses
        # of one ply in 20 and 40 steps; in 5 steps 5, and 9 where two plies crumple
        low, high = (rounded(setup + each * steps * seconds * cells, 2) for each in (0.6, 1.5))
        return f"{low} to {high} s"

    size = scene_output.sizes(scene)
    lines = [
        f"{size['cells']} cells ({size['element']}), {size['dofs']} degrees of freedom; "
        f"{', '.join(scene_output.summary(scene)['terms'])}",
        f"the run takes {cost()}, or several times this with few steps or where plies crumple: "
        f"{iterations} iterations at the first of {job.steps:g} steps took "
        f"{rounded(seconds, 2)} s, setup took {rounded(setup, 2)} s",
    ]
    if job.error:
        fewer = cost(1 / 4, job.coarser_settings(job.setup.fewer_steps).steps, setup=0)
        lines.append(f"the error estimate on coarser cells takes {fewer} more")
    memory = rounded(comm.allreduce(peak, MPI.SUM), 2)
    return [*lines, f"memory without pictures about {memory} MiB"]


@task("taking the first step")
def _first_step(newton, job):
    """Iterations up to the first state under load, and why there is none, or ""."""
    stepping = LoadStepping(newton, job, stop=lambda: "enough" if stepping.progress.load else "")
    outcome = stepping.run()
    return outcome.iterations, "" if outcome.reached else outcome.reason
