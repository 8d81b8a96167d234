"""The checks of a job without its run."""

import resource
import time

from mpi4py import MPI

from ..results.output import Output
from ..runtime.collective_errors import all_or_none
from ..runtime.formatting import rounded
from ..runtime.status import task
from ..scene import output as scene_output
from ..solve.newton import Newton
from . import validity
from .job import Job


def checked(job: Job, output: Output, part: str, pictures: bool) -> list[str]:
    """Check all that a run checks before its first step, draw its first picture, and factor the
    tangent once; sentences on the size and the cost. Raises InputError as `Job.run`."""
    scene, comm = job.scene, job.scene.comm
    with all_or_none(comm), task("checking the scene"):
        scene.check_start()
    folder = output.folder(part)
    for warning in [*job.setup.warnings, *validity.warnings_at_start(scene)]:
        output.tell(warning)
    newton = Newton(scene, job.tolerance, linear_solver=job.linear_solver)
    with task("factoring a tangent"):
        for _ in range(2):  # the first time compiles
            began = time.process_time()
            newton.objective(newton.x)
            newton.tangent.assemble()
            newton.tangent.factor()
            seconds = time.process_time() - began
    scene_output.nodal_fields(scene, scene_output.cell_fields(scene))  # no name is given twice
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    if pictures:
        job.setup.first_picture(folder)
    terms = ", ".join(scene_output.summary(scene)["terms"])
    size = scene_output.sizes(scene)
    return [
        f"{size['cells']} cells ({size['element']}), {size['dofs']} degrees of freedom; {terms}",
        f"an iteration takes about {rounded(seconds, 2)} s; with 10 of them a step, "
        f"{job.steps:g} steps take {rounded(10 * job.steps * seconds, 2)} s",
        f"memory without pictures about {rounded(comm.allreduce(peak, MPI.SUM), 2)} MiB",
    ]
