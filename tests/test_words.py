"""Messages of the whole package have one form."""

import ast
import re

import pytest
from test_layout import TREES

# words after which "allowed" says what is
ALLOWED = r"allowed (?:is|are|(?:with|in|for) [^;]*? (?:is|are))(?: |$)"


def texts(tree):
    """(line, text) of each text of three words or more, what is put into it as {expression}; one
    text within another, and what is no sentence, as a docstring, is left out."""
    inner = {id(c) for n in ast.walk(tree) if isinstance(n, ast.JoinedStr) for c in ast.walk(n)}
    docs = {id(n.value) for n in ast.walk(tree) if isinstance(n, ast.Expr)}
    for node in ast.walk(tree):
        if isinstance(node, ast.JoinedStr):
            yield node.lineno, ast.unparse(node)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            if id(node) not in inner | docs and node.value.count(" ") > 1:
                yield node.lineno, node.value


@pytest.mark.parametrize("name", sorted(TREES))
def test_no_word_is_doubled_or_falls_apart(name):
    for line, text in texts(TREES[name]):
        assert not re.search(r"\b([a-z]{2,}) \1\b", text), (name, line, text)
        for told in re.findall(r"(?<=; )allowed .*", text):
            assert re.match(ALLOWED, told), (name, line, told)


@pytest.mark.parametrize("name", sorted(TREES))
def test_shares_are_told_by_one_formatter(name):
    """Which has no exponent, as 1e+02 % has one."""
    if name.startswith("identification.curves") or name == "runtime.formatting":
        return
    for line, text in texts(TREES[name]):
        assert not re.search(r"\{100 \*[^{}]*:[^{}]*g\} %", text), (name, line, text)
