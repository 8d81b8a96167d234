"""Messages speak of parameters; a command line speaks of its options."""

import pytest

import fabric_fenicsx as ff
from fabric_fenicsx.cli.study import parser

pytestmark = pytest.mark.versions


def test_parameters_become_options():
    told = parser(ff.Tensile, "").translated("`max_step` or 5 % (`Limits.strain`); `resume=True`")
    assert told == "--max-step or 5 % (--max-strain); --resume"


@pytest.mark.parametrize(
    "words, told",
    [
        ("--pattern cros", "argument --pattern: invalid choice: 'cros'"),
        ("--elment P2", "unrecognized arguments: --elment P2; --help tells what is allowed"),
        ("--strain 3%", "argument --strain: 3% is not allowed; allowed is a fraction above 0"),
    ],
)
def test_bad_options_are_input_errors_in_argparses_words(words, told):
    with pytest.raises(ff.InputError) as error:
        parser(ff.Tensile, "").parse_args(words.split())
    assert str(error.value).startswith(told)
