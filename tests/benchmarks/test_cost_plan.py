"""Plans of runs: one factor at a time from the baseline."""

from bench.cost_plan import Configuration, on, plan, plan_forming


def test_plans_begin_with_the_baseline_and_repeat_nothing():
    two = [{"mesh": "P1 left 8", "steps": 5}, {"mesh": "P2 left 4", "steps": 5}]
    assert on("P1 left 8, P2 left 4", steps=5) == two
    runs = plan(["tensile", "bias10"], False)
    assert len(runs) == len({str(c) for c in runs}) and Configuration("bias10") in runs
    forming = plan_forming([0, 30], False)
    assert len(forming) == 18 and forming[-1].mesh == "P2 crossed 47"
