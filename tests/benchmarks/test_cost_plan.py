"""Plans of runs: one factor at a time from the baseline."""

from bench.cost_plan import Configuration, plan, plan_sizes, varied


def test_the_last_factor_is_the_fastest():
    changes = [*varied("mesh", nx=[8, 16], element=["P1", "P2"], steps=5)]
    assert [(c["nx"], c["element"]) for c in changes] == [
        (8, "P1"),
        (8, "P2"),
        (16, "P1"),
        (16, "P2"),
    ]
    assert all(c["sweep"] == "mesh" and c["steps"] == 5 for c in changes)
    assert [*varied("mesh", element_nx=[("P1", 8)])] == [
        {"sweep": "mesh", "element": "P1", "nx": 8}
    ]


def test_plans_begin_with_the_baseline_and_repeat_nothing():
    for quick, count in ((True, 6), (False, 83)):
        runs = plan(["tensile", "bias10"], quick)
        assert len(runs) == 2 * count and runs[0].sweep == runs[count].sweep == "baseline"
        assert len({str(c) for c in runs}) == len(runs)
    assert plan_sizes(True)[-1] == Configuration("tensile", "size", nx=48, steps=0, ranks=2)
