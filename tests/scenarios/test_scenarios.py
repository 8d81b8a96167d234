"""Scenarios as dataclasses: their fields are checked, and scripts have the same ones."""

import dataclasses

import pytest

import fabric_fenicsx as ff
from fabric_fenicsx.command_line.study import parser

SCENARIOS = ff.Tensile, ff.BiasExtension, ff.PictureFrame, ff.Forming


@pytest.mark.parametrize("kind", SCENARIOS)
def test_options_are_the_fields_with_their_defaults(kind):
    options = vars(parser(kind, "").parse_args([]))
    for each in dataclasses.fields(kind):
        if "help" in each.metadata:
            default = [] if "repeated" in each.metadata else each.default
            assert options[each.name] == default, each.name


@pytest.mark.parametrize(
    "kind, fields, words",
    [
        (ff.Tensile, {"nx": 0}, "nx is 0; allowed is a whole number of 1 or more"),
        (ff.Tensile, {"nx": 2.5}, "nx is 2.5; allowed is a whole number of 1 or more"),
        (ff.Tensile, {"strain": float("nan")}, "strain is nan; allowed is a fraction"),
        (ff.Tensile, {"width": "wide"}, "width is wide; allowed is a number above 0"),
        (ff.Tensile, {"pattern": "zigzag"}, "pattern is 'zigzag'; allowed is one of crossed"),
        (ff.Tensile, {"grips": "glue"}, "grips is 'glue'; allowed is one of clamped, rollers"),
        (ff.BiasExtension, {"length": 80}, "allowed is a length of 2 widths or more"),
        (ff.BiasExtension, {"in_plane_bending": 1, "element": "P2"}, "allowed is P1"),
        (ff.PictureFrame, {"fibre_angle": 30}, "allowed is 0 and 90, along its arms"),
        (ff.PictureFrame, {"pre_tension": 0.5}, "allowed is a strain from 0 to 0.1"),
        (ff.Forming, {"dome": {"depht": 3}}, "dome depht=3 names no dimension"),
        (ff.Forming, {"stroke": 1000, "nx": 4}, "stroke 1000 is deeper than the die"),
        (ff.Forming, {"punch": ff.Sphere(5, (0, 0, -5)), "nx": 4}, "stroke is not given"),
    ],
)
def test_a_field_that_is_not_allowed(kind, fields, words):
    with pytest.raises(ff.InputError) as error:
        kind(**fields)
    assert words in str(error.value)


@pytest.mark.parametrize("kind", [ff.Tensile, ff.BiasExtension])
def test_defaults_are_those_of_the_scripts(kind):
    made = kind()
    job = made.job()
    assert (made.nx, made.element, job.steps) == (32, "P2", 20)
    assert (job.tolerance, job.path_tolerance, job.every) == (1e-8, 1e-4, 5)


def test_a_ply_over_ones_own_punch():
    """A dome given as a surface is the dome given by its dimensions, but for being asked twice."""
    coarse = {"nx": 6, "stroke": 10}
    found = []
    for punch in ({"punch": ff.DoubleDome(depth=55)}, {"dome": {"depth": 55}}):
        result = ff.Forming(**coarse, **punch).job(steps=4).run()
        assert result.summary["converged"]
        found.append([row["reaction_N"] for row in result.rows])
    assert found[0] == pytest.approx(found[1], rel=1e-9) and found[0][-1] > 0
