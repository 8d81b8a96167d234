"""Results of parts of a benchmark, kept in done.json, so that one that is resumed has them."""

import json
from collections.abc import Callable
from typing import Any

import fabric_fenicsx as ff
from fabric_fenicsx.runtime.collective_errors import on_root
from fabric_fenicsx.runtime.files import replace_file


def once(study: Any, key: str, make: Callable[..., Any], *of: Any) -> Any:
    """make(*of), which JSON must hold; a resumed study takes what it gave before. InputError if
    that was for other options."""
    path = study.folder() / "done.json"
    problem = json.loads(json.dumps(study.problem(study.fabric)))

    def read():
        if not path.is_file():
            return {"problem": problem, "done": {}}
        try:
            known = json.loads(path.read_text())
            return {name: dict(known[name]) for name in ("problem", "done")}
        except (ValueError, TypeError, KeyError) as error:
            flaw = f"{path} cannot be read ({type(error).__name__}: {error})"
            raise ff.InputError(f"{flaw}; allowed is one that a study wrote") from None

    known = on_root(study.comm, read)
    for name, value in problem.items():
        if (before := known["problem"].get(name)) != value:
            flaw = f"{path} was made with {name} = {before}, now it is {value}"
            raise ff.InputError(f"{flaw}; allowed is the same, or a run that begins anew")
    if key not in known["done"]:
        known["done"][key] = make(*of)
        if study.comm.rank == 0:
            replace_file(path, json.dumps(known))
    return known["done"][key]
