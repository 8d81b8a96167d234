"""The stages of a press: which tools move, and how, one stage after the other."""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from ..runtime.errors import InputError
from ..runtime.fields import check_fields, number
from ..runtime.rules import COUNT, FINITE, FROM_ZERO, POSITIVE, shown, unknown_key
from ..tools.values import checked_vector

PICTURES = 6  # of a filmstrip


@dataclass(frozen=True)
class Stage:
    """What happens from one moment to the next.

    - name: what results call it
    - moves: of tools {name: how far towards the blank, or a vector (3,)} [mm]; less than 0 is away
    - forces: at its end, of tools that a force moves {name: on the whole blank} [N]
    - pressures: at its end, of holders with a pressure {name: value} [MPa]
    - leave: names of tools that go back to where they stood at the start
    - steps: into how many load steps it is divided
    - unload: whether all tools and holders are taken away; of the last stage alone

    All change in proportion to the load. Raises InputError for other values.
    """

    name: str = ""
    moves: Mapping[str, float | Sequence[float]] = field(default_factory=dict)
    forces: Mapping[str, float] = field(default_factory=dict)
    pressures: Mapping[str, float] = field(default_factory=dict)
    leave: Sequence[str] = ()
    steps: int = number(40, COUNT, "load steps")
    unload: bool = False

    def __post_init__(self) -> None:
        label = self.name or "a stage"
        check_fields(self, lambda name: f"{name} of {label}")
        for kind, rule in (("forces", POSITIVE), ("pressures", FROM_ZERO)):
            for name, value in _table(self, kind, label).items():
                rule.check(f"{kind}.{name} of {label}", value)
        for name, value in _table(self, "moves", label).items():
            where = f"moves.{name} of {label}"
            is_vector = isinstance(value, (list, tuple, np.ndarray))
            (checked_vector if is_vector else FINITE.check)(where, value)
        if isinstance(self.leave, str) or not all(isinstance(each, str) for each in self.leave):
            raise InputError(f"leave of {label} is {shown(self.leave)}; allowed are tools' names")
        if self.unload and (self.moves or self.forces or self.pressures or self.leave):
            raise InputError(
                f"{label} has `unload` beside what moves; allowed is a stage of its own"
            )


def _table(stage, kind, label):
    found = getattr(stage, kind)
    if not isinstance(found, Mapping):
        raise InputError(f"{kind} of {label} is {shown(found)}; allowed is a table of names")
    return found


class Course:
    """What tools and holders do over the load factor, from 0 to 1 over all `stages` in proportion
    to their steps.

    towards: of each tool the way to the blank {name: (3,)}; forces, pressures: those at the start,
    of tools that a force moves [N] and of holders that press [MPa], {name: value}. Raises
    InputError for stages that name what is not there.
    """

    def __init__(
        self,
        stages: Sequence[Stage],
        towards: Mapping[str, np.ndarray],
        forces: Mapping[str, float],
        pressures: Mapping[str, float],
    ) -> None:
        self.stages = [
            dataclasses.replace(stage, name=stage.name or f"stage {k}")
            for k, stage in enumerate(stages, 1)
            if not stage.unload
        ]
        if not self.stages:
            raise InputError("there is no stage that forms; allowed are one or more, as [[stage]]")
        if any(stage.unload for stage in list(stages)[:-1]):
            raise InputError("`unload` is no last stage; allowed is it at the end")
        self.unloads = bool(stages[-1].unload)
        self.steps = sum(stage.steps for stage in self.stages)
        self.joints = np.append(0, np.cumsum([s.steps for s in self.stages])) / self.steps
        self._places = {name: [np.zeros(3)] for name in towards}
        self._forces = {name: [value] for name, value in forces.items()}
        self._pressures = {name: [value] for name, value in pressures.items()}
        names = [stage.name for stage in self.stages]
        if twice := next((name for name in names if names.count(name) > 1), ""):
            raise InputError(f"two stages are called {twice}; allowed are different names")
        for stage in self.stages:
            self._add(stage, stage.name, towards)
        for name, places in self._places.items():
            ways = [float(place @ towards[name]) for place in places]
            if min(ways) < 0 and max(ways) <= 0:
                raise InputError(
                    f"tool {name} only goes away from the blank; allowed is one that comes nearer: "
                    "more than 0 in `moves` is towards the blank"
                )

    def _add(self, stage, label, towards):
        if not (stage.moves or stage.forces or stage.pressures or stage.leave):
            raise InputError(
                f"{label} changes nothing; allowed is one that has moves, forces, pressures or "
                "leave"
            )
        for kind, known in (("forces", self._forces), ("pressures", self._pressures)):
            for name in getattr(stage, kind):
                if name not in known:
                    has = "a force" if kind == "forces" else "a pressure"
                    raise InputError(
                        f"{kind}.{name} of {label} names nothing that has {has} from the start; "
                        f"allowed are names of those: {', '.join(known) or 'here none'}"
                    )
            for name, values in known.items():
                values.append(getattr(stage, kind).get(name, values[-1]))
        for name in (*stage.moves, *stage.leave):
            if name not in towards:
                raise unknown_key(name, towards, f"tool {name} of {label}")
            if name in self._forces:
                raise InputError(
                    f"tool {name} of {label} is moved by its force; allowed is a new one, as "
                    f"forces.{name}"
                )
        for name, places in self._places.items():
            if name in stage.leave:
                if name in stage.moves:
                    raise InputError(
                        f"tool {name} of {label} moves and leaves; allowed is one of them"
                    )
                if not places[-1].any():
                    raise InputError(
                        f"tool {name} of {label} leaves, but stands where it began; allowed is one "
                        "that has moved"
                    )
                places.append(np.zeros(3))
                continue
            move = stage.moves.get(name, 0.0)
            along = towards[name] * move if np.ndim(move) == 0 else np.asarray(move, dtype=float)
            places.append(places[-1] + along)

    def path(self, name: str, start: np.ndarray) -> Callable[[float], np.ndarray]:
        """Function of the load factor to where the tool's origin is, (3,) [mm]; start (3,)."""
        places = np.array(self._places[name]) + start

        def place(load):
            return np.array([np.interp(load, self.joints, axis) for axis in places.T])

        return place

    def force(self, name: str) -> Callable[[float], float]:
        """Function of the load factor to a tool's force on the whole blank [N]."""
        return lambda load: float(np.interp(load, self.joints, self._forces[name]))

    def pressure(self, name: str) -> Callable[[float], float]:
        """Function of the load factor to a holder's pressure [MPa]."""
        return lambda load: float(np.interp(load, self.joints, self._pressures[name]))

    def is_moved(self, name: str) -> bool:
        """Whether any stage moves the tool, or a force does."""
        return name in self._forces or bool(np.ptp(self._places[name], axis=0).any())

    def first_move(self, name: str) -> np.ndarray:
        """How far the tool goes in the first stage that moves it (3,) [mm]."""
        steps = np.diff(self._places[name], axis=0)
        moved = steps[steps.any(1)]
        return moved[0] if len(moved) else np.zeros(3)

    def shown(self) -> np.ndarray:
        """Load factors of about `PICTURES` pictures: the stages' ends, and between them as many in
        each."""
        each = max(1, round((PICTURES - 1) / len(self.stages)))
        ends = np.arange(len(self.joints))
        return np.interp(np.arange(each * ends[-1] + 1) / each, ends, self.joints)

    def leaders(self) -> list[str]:
        """Of each stage the tool whose force and travel its curve shows: the one that goes
        farthest, or "" where none moves."""
        found = []
        for k in range(len(self.stages)):
            goes = {n: float(np.linalg.norm(p[k + 1] - p[k])) for n, p in self._places.items()}
            farthest = max(goes, key=lambda name: goes[name], default="")
            found.append(farthest if goes.get(farthest) else "")
        return found

    def stage_at(self, load: float) -> int:
        """Number of the stage that a load factor is in, from 0."""
        return int(np.clip(np.searchsorted(self.joints, load) - 1, 0, len(self.stages) - 1))

    def travel(self, load: float) -> float:
        """How far the leading tools have gone, all stages together [mm]."""
        total = 0.0
        for k, name in enumerate(self.leaders()):
            low, high = self.joints[k : k + 2]
            share = np.clip((load - low) / (high - low), 0, 1)
            if name:
                before, after = self._places[name][k : k + 2]
                total += share * float(np.linalg.norm(after - before))
        return total
