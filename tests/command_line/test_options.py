"""Messages speak of parameters; a command line speaks of its options."""

import pytest

import fabric_fenicsx as ff
from fabric_fenicsx.command_line.study import parser

pytestmark = pytest.mark.versions


def test_parameters_become_options():
    told = parser(ff.Tensile, "").translated("`max_step` or 5 % (`Limits.strain`); `resume=True`")
    assert told == "--max-step or 5 % (--max-strain); --resume"


@pytest.mark.parametrize(
    "words, told",
    [
        ("--pattern cros", "--pattern is cros (did you mean crossed?); allowed is one of crossed"),
        ("--elment P2", "option --elment is unknown (did you mean --element?); allowed are those"),
        ("--strain 3%", "--strain is 3%; allowed is a fraction above 0 and up to 1"),
        ("extra", "word extra belongs to no option; allowed are those that --help tells"),
    ],
)
def test_bad_options_are_told_in_the_form_of_all_messages(words, told):
    with pytest.raises(ff.InputError) as error:
        parser(ff.Tensile, "").parse_args(words.split())
    assert str(error.value).startswith(told)
