"""Programs whose reader has gone, as `| head` does."""

import subprocess
import sys

import pytest


@pytest.mark.versions
def test_a_program_whose_reader_has_gone_ends_without_words(hang):
    code = "import fabric_fenicsx as ff; ff.Job; [print(n, flush=True) for n in range(10**6)]"
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    program = subprocess.Popen([sys.executable, "-c", code], **pipes, text=True)
    program.stdout.readline()
    program.stdout.close()
    assert (program.stderr.read(), program.wait(hang)) == ("", -13)
