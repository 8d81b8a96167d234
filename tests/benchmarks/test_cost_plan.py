"""Plans of runs: one factor at a time from the baseline."""

from bench.cost_plan import Configuration, on, plan, plan_forming, plan_sizes


def test_a_change_for_each_mesh():
    assert [c["mesh"] for c in on("P1 left 8 16, P2 left 4")] == [
        "P1 left 8",
        "P1 left 16",
        "P2 left 4",
    ]
    assert on("P1 left 8", steps=5) == [{"mesh": "P1 left 8", "steps": 5}]


def test_plans_begin_with_the_baseline_and_repeat_nothing():
    for quick, count in ((True, 6), (False, 83)):
        runs = plan(["tensile", "bias10"], quick)
        assert len(runs) == len({str(c) for c in runs}) == 2 * count
        base = {"mesh": "P1 crossed 24", "steps": 5} if quick else {}
        assert runs[count] == Configuration("bias10", **base)
    size = {"mesh": "P1 crossed 48", "steps": 0, "ranks": 2}
    assert plan_sizes(True)[-1] == Configuration("tensile", **size)
    forming = plan_forming([0, 30], False)
    assert len(forming) == 18 and forming[-1].mesh == "P2 crossed 47"
