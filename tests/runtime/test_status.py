"""The line that tells what a run is doing, on a terminal and elsewhere."""

import fcntl
import os
import pty
import struct
import subprocess
import sys
import termios
import time
from contextlib import suppress

from fabric_fenicsx.runtime import status

PROGRAM = """
import sys, time
from fabric_fenicsx.runtime import status
with status.shown(), status.task("waiting"):
    time.sleep(1.2)
    print("a message")
    print("a warning", file=sys.stderr)
"""


def test_silence_is_broken_where_there_is_no_terminal(capsys, monkeypatch):
    monkeypatch.setattr(status, "RENEWED", 0.01)
    monkeypatch.setattr(status, "SILENCE", 0.2)
    with status.shown(), status.task("meshing a.step"):
        with status.task(lambda: "step 3"):
            time.sleep(0.3)
        print("a message")
        time.sleep(0.1)
        assert capsys.readouterr().out == "step 3\na message\n"
        time.sleep(0.2)
    assert capsys.readouterr().out == "meshing a.step, 00:00\n"
    assert status.doing() == ""


def test_nothing_is_shown_unless_asked_for(capsys, monkeypatch):
    monkeypatch.setattr(status, "RENEWED", 0.01)
    monkeypatch.setattr(status, "SILENCE", 0.0)
    for how in ({"lines": False}, {"first": False}):
        with status.shown(**how), status.task("waiting"):
            time.sleep(0.05)
    assert capsys.readouterr().out == ""


def test_one_line_renews_itself_on_a_terminal():
    ours, its = pty.openpty()
    fcntl.ioctl(its, termios.TIOCSWINSZ, struct.pack("HHHH", 24, 80, 0, 0))
    command, text = [sys.executable, "-c", PROGRAM], b""
    # what MPI has set in this process, if another test began it, is not in os.environ
    with subprocess.Popen(command, stdout=its, stderr=its, env=dict(os.environ)):
        os.close(its)
        with suppress(OSError):  # when the program has ended
            while more := os.read(ours, 1000):
                text += more
    os.close(ours)
    lines = [line.strip() for line in text.decode().replace("\n", "").split("\r")]
    told = [line for line in lines if line]
    assert told[0] == "waiting, 00:00" and "waiting, 00:01" in told
    assert "a message" in told and "a warning" in told and lines[-1] == ""
