"""The line that tells what a run is doing, on a terminal and elsewhere."""

import time

from fabric_fenicsx.runtime import status


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
