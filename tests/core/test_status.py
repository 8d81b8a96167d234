"""Lines of the status, and readers that have gone."""

import os
import pty
import subprocess
import sys
import termios
import time

import pytest

from fabric_fenicsx.core import status
from fabric_fenicsx.core.cache_folders import RANK


def test_lines_tell_of_the_last_task_where_there_is_no_terminal(capsys):
    with status.shown(seconds=0.2), status.task("meshing a.step"):
        with status.task(lambda: "step 3"):
            time.sleep(0.3)
        time.sleep(0.2)
    assert capsys.readouterr().out == "step 3\nmeshing a.step, 00:00\n"
    assert status.doing() == ""


def test_on_a_terminal_one_line_renews_itself_below_what_is_printed():
    code = (
        "import time; from fabric_fenicsx.core import status\n"
        "with status.shown(), status.task('meshing a.step'):\n"
        "    time.sleep(0.8); print('a message'); time.sleep(0.7)"
    )
    mine, its = pty.openpty()
    termios.tcsetwinsize(its, (24, 80))
    env = {name: value for name, value in os.environ.items() if name not in RANK}
    process = subprocess.Popen([sys.executable, "-c", code], stdout=its, stderr=its, env=env)
    assert process.wait(60) == 0
    os.close(its)
    words = os.read(mine, 10_000).decode().replace("\r", "\n").split("\n")
    lines = [line.strip() for line in words if line.strip()]
    seen = [line.removesuffix("0").removesuffix("1") for line in dict.fromkeys(lines)]
    assert seen[:2] == ["meshing a.step, 00:0", "a message"]
    assert lines[-1].startswith("meshing a.step, 00:0")


@pytest.mark.versions
def test_a_program_whose_reader_has_gone_ends_without_words(hang):
    code = "import fabric_fenicsx as ff; ff.Job; [print(n, flush=True) for n in range(10**6)]"
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    program = subprocess.Popen([sys.executable, "-c", code], **pipes, text=True)
    program.stdout.readline()
    program.stdout.close()
    assert (program.stderr.read(), program.wait(hang)) == ("", -13)
