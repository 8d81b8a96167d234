"""What is believed, and how a run ends that is not."""

import fabric_fenicsx as ff


def test_a_value_just_beyond_its_limit_has_the_digits_that_tell():
    (sentence,) = ff.Limits().exceeded({"penetration": 0.100004, "imbalance": 0.05, "viscous": 0.0})
    assert "by 10.0004 % of its thickness; allowed is 10 % (`Limits.penetration`)" in sentence


def test_a_run_beyond_a_limit_ends_with_the_reason_and_may_go_on_with_another(launch):
    options = "tensile", "--nx", 8, "--steps", 4, "--no-pictures"
    done = launch(*options, "--max-strain", 0.02)
    assert done.status == 3
    assert "not to be believed" in done.err
    assert "--max-strain" in done.err
    assert not done.summary["converged"] and done.summary["reason"] in done.err
    assert 0.5 < done.summary["stroke_reached"] < 1
    done = launch(*options, "--resume")
    assert done.status == 0 and done.summary["converged"] and done.summary["stroke_reached"] == 1, (
        done.err
    )
    assert launch(*options, "--max-imbalance", 1e-6).status == 3


def test_a_ply_that_tools_cut_into_is_not_formed_further(launch):
    options = "--nx", 6, "--steps", 4, "--max-penetration", 1e-3, "--no-pictures"
    changes = "--set", "contact.penalty=680", "--set", "stage.1.moves.punch=8"
    done = launch("double_dome", *changes, *options)
    assert done.status == 3 and "; deepest is die at (" in done.summary["reason"], done.err
    assert done.summary["stroke_reached"] < 0.5
