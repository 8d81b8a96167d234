"""Programs whose reader has gone, as `| head` does."""

import subprocess
import sys

import pytest

IMPORTED = "import fabric_fenicsx as ff; ff.Job; "


@pytest.mark.versions
def test_a_program_whose_reader_has_gone_ends_without_words(hang):
    words = ["-c", IMPORTED + "[print(n, flush=True) for n in range(10**6)]"]
    program = subprocess.Popen(
        [sys.executable, *words], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    program.stdout.readline()
    program.stdout.close()
    assert (program.stderr.read(), program.wait(hang)) == ("", -13)


@pytest.mark.versions
def test_another_broken_pipe_is_an_exception(hang):
    words = "import os; r, w = os.pipe(); os.close(r)\ntry: os.write(w, b'x')\n"
    words += "except BrokenPipeError: print('told')"
    program = [sys.executable, "-c", IMPORTED + words]
    done = subprocess.run(program, capture_output=True, text=True, timeout=hang)
    assert (done.returncode, done.stdout, done.stderr) == (0, "told\n", "")
